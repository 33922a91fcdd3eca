"""Workers of a cluster that cannot be used, and files that are not where they are wanted."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

import fitting
from fitting.engine import run
from fitting.engine.run import NeededFile, opened, place_of
from fitting.text.errors import BadInput


def test_without_the_package_it_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    monkeypatch.delitem(sys.modules, "fitting.engine.cluster", raising=False)
    with (
        pytest.raises(BadInput, match="distributed"),
        opened("tcp://127.0.0.1:9", ()),
    ):
        pass


@pytest.mark.parametrize("address", ["nonsense", "localhost", "tcp://a:b", "tcp://", "http://"])
def test_an_address_without_host_and_port_is_refused_before_a_client_is_made(
    address: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("distributed", reason="fmu-fit[cluster] is not installed")

    def never(*_: object, **__: object) -> None:
        raise AssertionError("a client that finds nobody hangs when it goes")

    monkeypatch.setattr("fitting.engine.cluster.Client", never)
    with pytest.raises(BadInput, match=f"'{address}'"), opened(address, ()):
        pass


def test_a_worker_of_another_version_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("distributed", reason="fmu-fit[cluster] is not installed")
    from fitting.engine.cluster import Files

    sent = Files({})
    monkeypatch.setattr(fitting, "__version__", "0.0.1")
    with pytest.raises(BadInput, match=r"\b0\.0\.1\b"):
        sent.setup(SimpleNamespace(local_directory=str(tmp_path)))


def test_a_file_that_was_sent_is_known_by_its_content(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(run, "_SENT", {})
    path = tmp_path / "model.fmu"
    path.write_bytes(b"one")
    file = NeededFile.of(path)
    assert place_of(file) == path
    (tmp_path / "there").mkdir()
    run.keep({file: b"one"}, tmp_path / "there")
    path.write_bytes(b"two")
    assert place_of(file).read_bytes() == b"one"
    assert place_of(NeededFile.of(path)) == path
    path.unlink()
    with pytest.raises(BadInput, match=re.escape(str(path))):
        place_of(NeededFile(str(path), "0"))
