"""Completion by a shell: what ``fmu-fit completion`` prints is run by the shells themselves."""

from __future__ import annotations

import shlex
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path

import pytest

from fitting.cli.words.parser import COMMANDS
from tests.support.in_process import told


@pytest.fixture(scope="module")
def script(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What bash is to read."""
    path = tmp_path_factory.mktemp("completion") / "fmu-fit"
    path.write_text(told("completion", "bash").out)
    return path


def bash(text: str, folder: Path) -> str:
    """What bash says to a text, without the completions of this machine."""
    words = ["bash", "--norc", "--noprofile", "-c", text]
    done = subprocess.run(words, capture_output=True, text=True, cwd=folder, check=True)
    assert done.stderr == ""
    return done.stdout


def completed(script: Path, words: Sequence[str]) -> list[str]:
    """What bash offers in place of the last word, as it asks for it when Tab is pressed."""
    text = (
        f"source {shlex.quote(str(script))}; set -- $(complete -p fmu-fit); "
        'while [ "$1" != -F ]; do shift; done; '
        f"COMP_WORDS=({shlex.join(words)}); COMP_CWORD={len(words) - 1}; "
        f'"$2" fmu-fit {shlex.join((words[-1], words[-2]))}; printf "%s\\n" "${{COMPREPLY[@]}}"'
    )
    return bash(text, script.parent).split()


def test_bash_reads_it_and_knows_the_command(script: Path) -> None:
    assert bash(f"bash -n {shlex.quote(str(script))}", script.parent) == ""
    asked = f"source {shlex.quote(str(script))}; complete -p fmu-fit"
    assert bash(asked, script.parent).rstrip().endswith(" fmu-fit")


@pytest.mark.parametrize(
    ("words", "offered"),
    [
        (("fmu-fit", "rec"), ["reconstruct"]),
        (("fmu-fit", "sweep", "--dir"), ["--direction"]),
        (("fmu-fit", "sweep", "--direction", ""), ["up", "down", "both"]),
        (("fmu-fit", "reconstruct", "--dry"), ["--dry-run"]),
        (("fmu-fit", "completion", "z"), ["zsh"]),
    ],
    ids=["command", "option", "value", "further option", "shell"],
)
def test_what_bash_offers(script: Path, words: tuple[str, ...], offered: list[str]) -> None:
    assert completed(script, words) == offered


def test_bash_offers_every_command(script: Path) -> None:
    assert set(completed(script, ("fmu-fit", ""))) == set(COMMANDS)


def test_bash_offers_files_where_a_file_is_wanted(script: Path) -> None:
    (script.parent / "model.fmu").touch()
    assert completed(script, ("fmu-fit", "check", "mod")) == ["model.fmu"]


@pytest.mark.parametrize("shell", ["zsh", "tcsh"])
def test_other_shells_get_every_command(shell: str, tmp_path: Path) -> None:
    ended = told("completion", shell)
    assert (ended.code, ended.err) == (0, "")
    assert all(name in ended.out for name in COMMANDS)


def test_zsh_is_told_that_several_files_may_be_named() -> None:
    """Of _arguments `*:what:which` is any number of words, `(*):what:which` is one.

    Several are taken by design, ensemble, init, line, posterior and reconstruct.
    """
    text = told("completion", "zsh").out
    assert sum(line.startswith('  "*:') for line in text.splitlines()) == 6
    assert '"(*)' not in text


#: What zsh on a terminal is to read first: every word that is offered goes into the file "offered",
#: and so does the line after Tab, by Ctrl-X n; Ctrl-X x ends.
IN_ZSH = """
PROMPT=READY; fpath=($PWD $fpath); autoload -Uz compinit; compinit -u -D; setopt extendedglob
compadd() {
  local -a hits
  if [[ "${@[1,(i)(-|--)]}" == *-[a-zA-Z]#[OADE](| *)* ]]; then builtin compadd "$@"; return; fi
  builtin compadd -O hits "$@"
  (( $#hits )) && print -rl -- $hits >> offered
  builtin compadd "$@"
}
next() { print -r -- "line:$BUFFER" >> offered; BUFFER= }
finish() { exit }
zle -N next; zle -N finish
bindkey -r '^X'; bindkey '^Xn' next; bindkey '^Xx' finish; bindkey '^I' complete-word
"""
#: Runs it on a terminal of its own, and types.
TYPED = """
zmodload zsh/zpty; zpty shell zsh -f -i
zpty -w shell 'source ./in.zsh'
zpty -r -m shell seen '*READY*'
for words in "$@"; do zpty -w -n shell "$words"$'\\t\\x18n'; done
zpty -w -n shell $'\\x18x'
while zpty -r shell seen; do :; done
"""


@pytest.mark.skipif(shutil.which("zsh") is None, reason="there is no zsh on this machine")
def test_what_zsh_offers(tmp_path: Path) -> None:
    """On a terminal of its own, in one session, as zsh keeps what it read."""
    (tmp_path / "_fmu-fit").write_text(told("completion", "zsh").out)
    (tmp_path / "in.zsh").write_text(IN_ZSH)
    (tmp_path / "typed.zsh").write_text(TYPED)
    for name in ("map.csv", "model.fmu"):
        (tmp_path / name).touch()
    offered = {
        "fmu-fit rec": {"reconstruct"},
        "fmu-fit sweep --dir": {"--direction"},
        "fmu-fit sweep --direction ": {"up", "down", "both"},
        "fmu-fit completion z": {"zsh"},
        "fmu-fit check mod": {"model.fmu"},
        "fmu-fit check model.fmu --campaign ma": {"map.csv"},
        "fmu-fit init map.csv mod": {"model.fmu"},
        "fmu-fit example string_q2": {"string_q2"},
        "fmu-fit ": set(COMMANDS),
    }
    words = ["zsh", "-f", "typed.zsh", *offered]
    subprocess.run(words, cwd=tmp_path, check=False, capture_output=True, timeout=120)
    found: list[set[str]] = [set()]
    for line in (tmp_path / "offered").read_text().splitlines():
        if line.startswith("line:"):
            found.append(set())
        else:
            found[-1].add(line)
    assert dict(zip(offered, found, strict=False)) == offered


def test_a_shell_that_is_not_known_is_refused() -> None:
    ended = told("completion", "fish")
    assert ended.code == 2
    assert "'fish'" in ended.err
