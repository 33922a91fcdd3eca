"""How a worker process gives up what an isolated FMU must not have; lives in that process only.

Limits of memory, processor time, files and written bytes are the system's (``setrlimit``). On
Linux, Landlock takes the right to write outside a folder, to control devices and to send signals
to other processes, a filter of system calls refuses what else reaches beyond the process,
capabilities are dropped, and there is a network of its own that leads nowhere. All of it holds for
every thread of the process and whatever it starts, and cannot be taken back.

A filter sees numbers, no paths: what changes rights, owners, times and attributes of files is
refused within the FMU's own folder as well. What Landlock keeps (writing, signals) is not in it.
"""

from __future__ import annotations

import ctypes
import errno
import os
import platform
import signal
import struct
import sys
import time
from pathlib import Path

from fitting.fmu.isolation import (
    CREATE_RULESET,
    MB,
    PROCESSORS,
    Isolation,
    lacks,
    landlock_version,
)

#: On x86-64, calls of its other ABI have this bit.
FOREIGN = 0x40000000
#: Calls that are refused: numbers by processor, and which argument names a process, where one may.
CALLS = Path(__file__).with_name("system_calls.txt")
SOCKET, SOCKETPAIR, CLONE, CLONE3, IOCTL = (41, 198), (53, 199), (56, 220), (435, 435), (16, 29)
INET, INET6, DATAGRAM, KIND = 2, 10, 2, 0xF
NAMESPACES = 0x7E020000  # flags of clone
TERMINALS = (0x5412, 0x541C)  # requests that type into a terminal: TIOCSTI, TIOCLINUX
#: What a filter answers.
ALLOW, KILL, REFUSE, UNKNOWN = 0x7FFF0000, 0x80000000, 0x50000 | errno.EPERM, 0x50000 | errno.ENOSYS
#: Codes of the kernel's filters: load a word, compare, test bits, keep bits, answer.
LOAD, EQUAL, AT_LEAST, ANY_BIT, KEEP, ANSWER = 0x20, 0x15, 0x35, 0x45, 0x54, 0x06
CALL, PROCESSOR, ARGUMENTS = 0, 4, 16

_Line = tuple[int, int, int, int]  # code, lines to skip if it holds, and if not, value


def filter_of(machine: str) -> bytes | None:
    """The filter in the kernel's bytes; None for a processor whose numbers are not known here.

    A connection to a network ends the process; everything else is refused. A socket of datagrams of
    a network is refused, no more: libraries read the number of the network card through one.

    Args:
        machine: as `platform.machine` names it.
    """
    if machine not in PROCESSORS:
        return None
    processor, place = PROCESSORS[machine]
    allow, refuse = (ANSWER, 0, 0, ALLOW), (ANSWER, 0, 0, REFUSE)
    kill = (ANSWER, 0, 0, KILL)

    def argument(number: int) -> _Line:
        # the lower half of it, which both processors have first
        return (LOAD, 0, 0, ARGUMENTS + 8 * number)

    network = [argument(1), (KEEP, 0, 0, KIND), (EQUAL, 0, 1, DATAGRAM), refuse, kill]
    typing = [line for each in TERMINALS for line in ((EQUAL, 0, 1, each), refuse)]
    # what is done at a call; it ends with an answer
    calls: list[tuple[int, list[_Line]]] = []
    for row in CALLS.read_text("ascii").splitlines():
        words = row.partition("#")[0].split()
        if words and words[1 + place] != "-":
            own = [argument(int(words[3])), (EQUAL, 1, 0, 0), refuse, allow] if words[3:] else []
            calls.append((int(words[1 + place]), own or [refuse]))
    calls += [
        (
            SOCKET[place],
            [argument(0), (EQUAL, 2, 0, INET), (EQUAL, 1, 0, INET6), refuse, *network],
        ),
        # one of datagrams could be pointed at any other program's
        (
            SOCKETPAIR[place],
            [argument(1), (KEEP, 0, 0, KIND), (EQUAL, 0, 1, DATAGRAM), refuse, allow],
        ),
        (CLONE[place], [argument(0), (ANY_BIT, 0, 1, NAMESPACES), refuse, allow]),
        # its flags are out of a filter's sight: libraries take clone where it is not there
        (CLONE3[place], [(ANSWER, 0, 0, UNKNOWN)]),
        (IOCTL[place], [argument(1), *typing, allow]),
    ]
    lines: list[_Line] = [
        (LOAD, 0, 0, PROCESSOR),
        (EQUAL, 1, 0, processor),
        kill,
        (LOAD, 0, 0, CALL),
        (AT_LEAST, 0, 1, FOREIGN),
        kill,
    ]
    for number, then in calls:
        lines += [(EQUAL, 0, len(then), number), *then]
    return b"".join(struct.pack("=HBBI", *line) for line in [*lines, allow])


CLONE_NEWUSER, CLONE_NEWNET, CLONE_NEWIPC = 0x10000000, 0x40000000, 0x08000000
SET_NO_NEW_PRIVS, SET_SECCOMP, FILTER, DROP_BOUNDING = 38, 22, 2, 24
CAPABILITIES_3, MOST_CAPABILITIES = 0x20080522, 64
ADD_RULE, RESTRICT_SELF = 445, 446
#: Rights that Landlock takes: write, remove and make, by bit; further ones by the version of it.
WRITES = (1 << 1) | sum(1 << bit for bit in range(4, 13))
REFER, TRUNCATE, CONTROL = (2, 1 << 13), (3, 1 << 14), (5, 1 << 15)  # from that version on
INTO_FILES = (1 << 1) | (1 << 14) | (1 << 15)  # those that a file itself has
CONNECTS = 4, 0b11  # from that version on: TCP, to bind and to connect
SCOPES = 6, 0b11  # from that version on: sockets by name, and signals


def leave_namespaces() -> None:
    """Go to a network and to messages of one's own, in which there is nothing, where one may.

    While the process has one thread only: a namespace of users takes that.
    """
    if sys.platform != "linux":
        return
    libc = ctypes.CDLL(None, use_errno=True)
    alone = CLONE_NEWNET | CLONE_NEWIPC
    user, group = os.getuid(), os.getgid()
    if libc.unshare(alone) == 0 or libc.unshare(CLONE_NEWUSER | alone) != 0:
        return
    try:  # be who one was
        Path("/proc/self/setgroups").write_text("deny")
        Path("/proc/self/uid_map").write_text(f"{user} {user} 1")
        Path("/proc/self/gid_map").write_text(f"{group} {group} 1")
    except OSError:
        pass  # files are still those of the same user


def confine(isolation: Isolation, folder: Path) -> tuple[str, ...]:
    """Give up what an isolated FMU must not have; sentences on what the system cannot hold.

    Args:
        isolation: limits.
        folder: in which alone it may write.
    """
    import resource

    if hasattr(signal, "SIGXFSZ"):
        signal.signal(signal.SIGXFSZ, signal.SIG_DFL)  # Python ignores it
    try:  # what the worker itself has taken, some of it only set aside
        own = int(Path("/proc/self/statm").read_text().split()[0]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        own = 1000 * MB
    for which, most in (
        (resource.RLIMIT_FSIZE, int(isolation.written_mb * MB)),
        (resource.RLIMIT_NOFILE, isolation.files),
        (resource.RLIMIT_CORE, 0),
        (resource.RLIMIT_AS, own + int(isolation.memory_mb * MB)),
    ):
        _, hard = resource.getrlimit(which)
        limit = most if hard == resource.RLIM_INFINITY else min(most, hard)
        resource.setrlimit(which, (limit, limit))

    kept = filtered = False
    if sys.platform == "linux":
        libc = ctypes.CDLL(None, use_errno=True)
        libc.prctl(SET_NO_NEW_PRIVS, 1, 0, 0, 0)
        kept = _keep_to(libc, folder)
        # be like any other user, also as the user who may do everything
        for capability in range(MOST_CAPABILITIES):
            libc.prctl(DROP_BOUNDING, capability, 0, 0, 0)
        libc.capset(struct.pack("=Ii", CAPABILITIES_3, 0), bytes(24))
        filtered = _refuse_calls(libc)
    missing = lacks(kept=kept, filtered=filtered)
    return tuple(f"isolated, but this system cannot hold all of it: {words}" for words in missing)


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

    Under Linux that begins with the memory of the process that started it; 0 where it is not known.
    """
    try:
        import resource
    except ImportError:  # Windows
        return 0
    unit = 1 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * unit


def _keep_to(libc: ctypes.CDLL, folder: Path) -> bool:
    """Take the right to write anywhere else; whether that succeeded."""
    version = landlock_version()
    rights = WRITES
    for since, right in (REFER, TRUNCATE, CONTROL):
        rights |= right if version >= since else 0
    # each version knows one field more
    fields = (rights, *(kept if version >= since else 0 for since, kept in (CONNECTS, SCOPES)))
    known = 1 + (version >= CONNECTS[0]) + (version >= SCOPES[0])
    attributes = struct.pack(f"={known}Q", *fields[:known])
    rules = libc.syscall(CREATE_RULESET, attributes, ctypes.c_size_t(len(attributes)), 0)
    if rules < 0:
        return False
    try:
        for path, granted in ((str(folder), rights), (os.devnull, rights & INTO_FILES)):
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


def _refuse_calls(libc: ctypes.CDLL) -> bool:
    """Filter the system calls; whether that succeeded."""
    lines = filter_of(platform.machine())
    if lines is None:
        return False
    code = ctypes.create_string_buffer(lines, len(lines))

    class Program(ctypes.Structure):
        _fields_ = (("length", ctypes.c_ushort), ("lines", ctypes.c_void_p))

    program = Program(len(lines) // 8, ctypes.addressof(code))
    return int(libc.prctl(SET_SECCOMP, FILTER, ctypes.byref(program), 0, 0)) == 0
