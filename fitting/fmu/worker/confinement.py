"""How a worker process gives up what an isolated FMU must not have; lives in that process only.

Limits of memory, processor time, files and written bytes are the system's (``setrlimit``). On
Linux, Landlock takes the right to write outside a folder and to send signals to other processes, a
filter of system calls ends the process where it asks for a network, and it has a network of its own
that leads nowhere. All of it holds for this thread and whatever it starts, the FMU's threads and
processes, and cannot be taken back.
"""

from __future__ import annotations

import ctypes
import os
import platform
import signal
import struct
import sys
import time
from pathlib import Path

from fitting.fmu.isolation import MB, Isolation

CLONE_NEWUSER, CLONE_NEWNET = 0x10000000, 0x40000000
SET_NO_NEW_PRIVS, SET_SECCOMP, FILTER = 38, 22, 2
#: Landlock's system calls have one number on every processor.
CREATE_RULESET, ADD_RULE, RESTRICT_SELF = 444, 445, 446
#: Rights that Landlock takes: write, remove and make, by bit; further ones by the version of it.
WRITES = (1 << 1) | sum(1 << bit for bit in range(4, 13))
REFER, TRUNCATE = (2, 1 << 13), (3, 1 << 14)  # from that version on
INTO_FILES = (1 << 1) | (1 << 14)  # those of WRITES and TRUNCATE that a file itself has
SCOPES, SCOPED = 6, 0b11  # from that version on: sockets by name, and signals
#: Name of the processor, as a filter knows it, and its number of ``socket``.
SOCKETS = {"x86_64": (0xC000003E, 41), "aarch64": (0xC00000B7, 198)}
IO_URING, FOREIGN = 425, 0x40000000  # FOREIGN: of the other ABI of x86-64
LOCAL, DATAGRAM = 1, 2
#: What a filter answers.
ALLOW, KILL, REFUSE = 0x7FFF0000, 0x80000000, 0x00050001


def leave_network() -> bool:
    """Go to a network of one's own, in which there is nothing; whether the system allows it.

    While the process has one thread only: a namespace of users takes that.
    """
    if sys.platform != "linux":
        return False
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.unshare(CLONE_NEWNET) == 0:
        return True
    user, group = os.getuid(), os.getgid()
    if libc.unshare(CLONE_NEWUSER | CLONE_NEWNET) != 0:
        return False
    try:  # be who one was
        Path("/proc/self/setgroups").write_text("deny")
        Path("/proc/self/uid_map").write_text(f"{user} {user} 1")
        Path("/proc/self/gid_map").write_text(f"{group} {group} 1")
    except OSError:
        pass  # files are still those of the same user
    return True


def confine(isolation: Isolation, folder: Path, *, has_network: bool) -> tuple[str, ...]:
    """Give up what an isolated FMU must not have; sentences on what the system cannot hold.

    Args:
        isolation: limits.
        folder: in which alone it may write.
        has_network: whether `leave_network` did not succeed.
    """
    os.environ["TMPDIR"] = str(folder)
    _limit(isolation)
    lacks = []
    landlocked = filtered = False
    if sys.platform == "linux":
        libc = ctypes.CDLL(None, use_errno=True)
        if libc.prctl(SET_NO_NEW_PRIVS, 1, 0, 0, 0) == 0:
            landlocked = _keep_to(libc, folder)
            filtered = _without_sockets(libc)
    if not landlocked:
        lacks.append("it may write files elsewhere, and send signals")
    if not filtered and has_network:
        lacks.append("it may use the network")
    return tuple(f"isolated, but this system cannot hold all of it: {words}" for words in lacks)


def allow_processor_time(isolation: Isolation) -> None:
    """From now on, the process may take the time of one run.

    Args:
        isolation: limits.
    """
    import resource

    _, hard = resource.getrlimit(resource.RLIMIT_CPU)
    soft = int(time.process_time() + isolation.processor_s) + 1
    resource.setrlimit(resource.RLIMIT_CPU, (soft, hard))


def most_memory() -> int:
    """The most resident memory that the system counts for this process so far, bytes.

    Under Linux that begins with the memory of the process that started it; 0 where it is not told.
    """
    try:
        import resource
    except ImportError:  # Windows
        return 0
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit


def _limit(isolation: Isolation) -> None:
    import resource

    def limit(which: int, most: int) -> None:
        _, hard = resource.getrlimit(which)
        most = most if hard == resource.RLIM_INFINITY else min(most, hard)
        resource.setrlimit(which, (most, most))

    if hasattr(signal, "SIGXFSZ"):
        signal.signal(signal.SIGXFSZ, signal.SIG_DFL)  # Python ignores it
    limit(resource.RLIMIT_FSIZE, int(isolation.written_mb * MB))
    limit(resource.RLIMIT_NOFILE, isolation.files)
    limit(resource.RLIMIT_CORE, 0)
    limit(resource.RLIMIT_AS, _address_space() + int(isolation.memory_mb * MB))


def _address_space() -> int:
    """What the worker itself has taken, in bytes; some of it is only set aside."""
    try:
        pages = int(Path("/proc/self/statm").read_text().split()[0])
    except OSError:
        return 1000 * MB
    return pages * os.sysconf("SC_PAGE_SIZE")


def _keep_to(libc: ctypes.CDLL, folder: Path) -> bool:
    """Take the right to write anywhere else; whether the system has Landlock."""
    version = libc.syscall(CREATE_RULESET, None, ctypes.c_size_t(0), 1)
    if version < 1:
        return False
    rights = WRITES
    for since, right in (REFER, TRUNCATE):
        rights |= right if version >= since else 0
    attributes = struct.pack("=QQQ", rights, 0, SCOPED)
    attributes = attributes if version >= SCOPES else attributes[:8]
    rules = libc.syscall(CREATE_RULESET, attributes, ctypes.c_size_t(len(attributes)), 0)
    if rules < 0:
        return False
    try:
        allowed = ((str(folder), rights), (os.devnull, rights & INTO_FILES))
        for path, granted in allowed:
            handle = os.open(path, os.O_PATH | os.O_CLOEXEC)
            try:
                rule = struct.pack("=Qi", granted, handle)
                if libc.syscall(ADD_RULE, rules, 1, rule, 0) != 0:
                    return False
            finally:
                os.close(handle)
        return int(libc.syscall(RESTRICT_SELF, rules, 0)) == 0
    finally:
        os.close(rules)


def _without_sockets(libc: ctypes.CDLL) -> bool:
    """End the process where it asks for a connection beyond this machine; whether that is held.

    A socket of datagrams is refused, no more: some libraries read the number of the network card
    through one that they never send by.
    """
    known = SOCKETS.get(platform.machine())
    if known is None:
        return False
    processor, socket = known
    # codes of the kernel's filters; a comparison goes on by so many lines if it holds, and if not
    load, equal, at_least, keep_bits, answer = 0x20, 0x15, 0x35, 0x54, 0x06
    lines = (
        (load, 0, 0, 4),  # the processor
        (equal, 0, 10, processor),
        (load, 0, 0, 0),  # the number of the call
        (at_least, 8, 0, FOREIGN),
        (equal, 8, 0, IO_URING),
        (equal, 0, 5, socket),
        (load, 0, 0, 16),  # its first argument: the kind of network
        (equal, 3, 0, LOCAL),
        (load, 0, 0, 24),  # its second one: the kind of socket
        (keep_bits, 0, 0, 0xF),
        (equal, 2, 1, DATAGRAM),
        (answer, 0, 0, ALLOW),
        (answer, 0, 0, KILL),
        (answer, 0, 0, REFUSE),
    )
    code = ctypes.create_string_buffer(b"".join(struct.pack("=HBBI", *line) for line in lines))

    class Program(ctypes.Structure):
        _fields_ = (("length", ctypes.c_ushort), ("lines", ctypes.c_void_p))

    program = Program(len(lines), ctypes.addressof(code))
    return int(libc.prctl(SET_SECCOMP, FILTER, ctypes.byref(program), 0, 0)) == 0
