"""Ensembles: one table, bit for bit, wherever and however often interrupted it is made."""

from __future__ import annotations

import json
import math
import os
import re
import signal
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from shutil import copyfile, copytree
from typing import Any

import pytest

import fitting as ff
from fitting.ensembles import ITEMS_FILE
from fitting.ensembles.api import Progress
from fitting.ensembles.report import csv_of, document, markdown
from fitting.text.journal import Journal
from fitting.text.records import json_text
from fitting.text.results_folder import open_folder_of, results_folder
from tests.support.clusters import cluster_of_two

COUNT = 4
OPTIONS = ff.EnsembleOptions(profiles=False)


def laboratories(count: int = COUNT) -> ff.Laboratories:
    """Lines of a network analyser: a fit takes a quarter of a second."""
    return ff.Laboratories("transmission", count, seed=3, changes={"points": 15})


def tables(found: ff.Ensemble) -> tuple[str, ...]:
    """What is written of it."""
    return json_text(document(found)), csv_of(found), markdown(found)


@pytest.fixture(scope="module")
def one_by_one(swift_fmu: Path) -> ff.Ensemble:
    """In a thread of this process."""
    with ThreadPoolExecutor(1) as pool:
        return ff.ensemble(laboratories(), swift_fmu, OPTIONS, executor=pool)


@pytest.fixture(scope="module")
def wanted(one_by_one: ff.Ensemble) -> tuple[str, ...]:
    """Its tables."""
    return tables(one_by_one)


def test_every_laboratory_is_fitted_as_by_hand(
    one_by_one: ff.Ensemble, swift_fmu: Path, tmp_path: Path
) -> None:
    """The same seed written, read and fitted without any ensemble."""
    ff.synthesize_curves("transmission", seed=4, out=tmp_path, points=15)
    with ff.Fmu(swift_fmu, workers=1) as fmu:
        fit = ff.fit(ff.Problem.of(tmp_path / "campaign.toml", fmu))
    row = one_by_one.rows[1]
    assert (row.index, row.label, row.status) == (1, "seed 4", fit.status)
    found = {value.name: value for value in row.values}
    assert set(found) == set(fit.values)
    for name, value in fit.values.items():
        assert (found[name].value, found[name].std) == (value.value, value.std)
        assert found[name].ci95 == value.interval(0.95)
    assert found["d1"].truth == 420e3
    assert found["Q_plus"].truth == pytest.approx(5e9 / 420e3)


def test_pulls_of_honest_laboratories_are_small(one_by_one: ff.Ensemble) -> None:
    assert [c.name for c in one_by_one.coverage] == ["eta_plus", "d1", "delay", "Q_plus"]
    for c in one_by_one.coverage:
        assert (c.judged, len(c.pulls)) == (COUNT, COUNT)
        assert max(map(abs, c.pulls)) < 5.0


def test_one_that_is_interrupted_goes_on_and_can_be_made_larger(
    wanted: tuple[str, ...], swift_fmu: Path, tmp_path: Path
) -> None:
    """First two of three items, then the rest of four; the last line of the journal is torn."""

    def interrupt(state: Progress) -> None:
        if state.done == 2:
            raise KeyboardInterrupt

    with ThreadPoolExecutor(2) as pool:
        part = ff.ensemble(
            laboratories(3), swift_fmu, OPTIONS, executor=pool, out=tmp_path, progress=interrupt
        )
    assert (part.status, len(part.rows), part.total) == ("interrupted", 2, 3)
    journal = tmp_path / ITEMS_FILE
    assert len(journal.read_text().splitlines()) == 3
    torn = '{"row":{"index":2,"label":"seed 5","status":"finished"}}\n'
    with results_folder(tmp_path, "ensemble"):  # a process that is killed has noted the whole line
        folder = open_folder_of(journal)
        assert folder is not None
        folder.add_to(journal, torn)
    journal.write_bytes(journal.read_bytes()[:-20])
    states: list[Progress] = []
    with ThreadPoolExecutor(2) as pool:
        found = ff.ensemble(
            laboratories(),
            swift_fmu,
            ff.EnsembleOptions(profiles=False, resume=True),
            executor=pool,
            out=tmp_path,
            progress=states.append,
        )
    assert [(s.done, s.resumed) for s in states] == [(k, 2) for k in range(2, COUNT + 1)]
    assert tables(found) == wanted
    labels = [json.loads(line)["row"]["label"] for line in journal.read_text().splitlines()[1:]]
    assert sorted(labels) == [f"seed {k}" for k in range(3, 3 + COUNT)]


def test_an_interrupt_between_an_items_line_and_its_row_loses_no_row(
    swift_fmu: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    add = Journal.record

    def added(self: Journal[Any], part: Any) -> None:
        add(self, part)
        raise KeyboardInterrupt

    monkeypatch.setattr(Journal, "record", added)
    with ThreadPoolExecutor(1) as pool:
        part = ff.ensemble(laboratories(2), swift_fmu, OPTIONS, executor=pool, out=tmp_path)
    assert (part.status, len(part.rows)) == ("interrupted", 1)
    assert len((tmp_path / ITEMS_FILE).read_text().splitlines()) == 2


def test_finished_items_of_another_ensemble_are_refused(swift_fmu: Path, tmp_path: Path) -> None:
    with ThreadPoolExecutor(1) as pool:
        ff.ensemble(laboratories(1), swift_fmu, OPTIONS, executor=pool, out=tmp_path)
        other = ff.Laboratories("transmission", 1, seed=3, changes={"points": 16})
        options = ff.EnsembleOptions(profiles=False, resume=True)
        with pytest.raises(ff.BadInput, match=re.escape(ITEMS_FILE)):
            ff.ensemble(other, swift_fmu, options, executor=pool, out=tmp_path)


@pytest.mark.nightly
def test_a_cluster_that_loses_a_worker_makes_the_same_table(
    wanted: tuple[str, ...], swift_fmu: Path, tmp_path: Path
) -> None:
    """Two dask workers, of which one is killed; the FMU that they were sent is gone meanwhile."""
    fmu = tmp_path / swift_fmu.name
    copyfile(swift_fmu, fmu)
    killed: list[int] = []

    def disturb(state: Progress) -> None:
        if state.done == 0:
            fmu.unlink()
        if state.done == 2:
            killed.append(next(iter(cluster.workers.values())).pid)
            os.kill(killed[0], signal.SIGKILL)

    with cluster_of_two() as cluster:
        address = cluster.scheduler_address
        found = ff.ensemble(
            laboratories(), fmu, OPTIONS, executor=address, out=tmp_path / "out", progress=disturb
        )
        with pytest.raises(ff.BadInput, match="nothing://here"):
            ff.ensemble(laboratories(1), swift_fmu, OPTIONS, executor="nothing://here")
    assert killed
    assert tables(found) == wanted


# -- campaigns ------------------------------------------------------------------------------------


@pytest.fixture
def campaigns(tmp_path: Path) -> Path:
    """Two that can be fitted, one whose data are missing, one that is none, one without an FMU."""
    folder = tmp_path / "campaigns"
    ff.synthesize_curves("transmission", seed=3, out=folder / "a", points=15)
    copytree(folder / "a", folder / "b" / "deep")
    truth = folder / "b" / "deep" / "truth.toml"
    truth.unlink()
    copytree(folder / "a", folder / "c")
    (folder / "c" / "sweep.csv").unlink()
    (folder / "d").mkdir()
    (folder / "d" / "campaign.toml").write_text("title = \n")
    copytree(folder / "a", folder / "e")
    path = folder / "e" / "campaign.toml"
    path.write_text(path.read_text().replace('model = "CoupledOscillator"', 'file = "no.fmu"'))
    return folder


def test_campaigns_of_a_folder_are_fitted_each_and_failures_say_why(
    campaigns: Path, swift_fmu: Path, one_by_one: ff.Ensemble, tmp_path: Path
) -> None:
    for name in ("a", "b/deep", "c"):
        path = campaigns / name / "campaign.toml"
        named = f'file = "{os.path.relpath(swift_fmu, path.parent)}"'
        path.write_text(path.read_text().replace('model = "CoupledOscillator"', named))
    with ThreadPoolExecutor(1) as pool:
        found = ff.ensemble(campaigns, None, OPTIONS, executor=pool, out=tmp_path / "out")
    a, b, c, d, e = found.rows
    assert a.label.endswith("campaigns/a/campaign.toml")
    assert [v.value for v in a.values] == [v.value for v in one_by_one.rows[0].values]
    assert [v.value for v in b.values] == [v.value for v in a.values]
    assert a.values[1].truth == 420e3
    assert all(math.isnan(v.truth) for v in b.values)  # nobody has said it
    assert [row.failed for row in found.rows] == [False, False, True, True, True]
    assert c.message.startswith(f"{campaigns}/c/sweep.csv: ")
    assert "campaign.toml" in d.message
    assert "no.fmu" in e.message
    assert re.findall(r"\d+", found.message) == ["5", "5", "3"]
    mend_and_resume(campaigns, found, tmp_path / "out")


def mend_and_resume(campaigns: Path, before: ff.Ensemble, out: Path) -> None:
    """What had failed is done again, and what was changed; the rest is not."""
    sweep = (campaigns / "a" / "sweep.csv").read_text()
    (campaigns / "c" / "sweep.csv").write_text(sweep)
    other = ff.synthesize_curves("transmission", seed=9, points=15).files["sweep.csv"]
    (campaigns / "b" / "deep" / "sweep.csv").write_text(str(other))
    table = campaigns.parent / "table.csv"
    table.write_text("campaign\n" + "".join(f"campaigns/{n}/campaign.toml\n" for n in "abc"))
    table.write_text(table.read_text().replace("/b/", "/b/deep/"))
    states: list[Progress] = []
    with ThreadPoolExecutor(1) as pool:
        options = ff.EnsembleOptions(profiles=False, resume=True)
        found = ff.ensemble(table, None, options, executor=pool, out=out, progress=states.append)
    assert (states[0].resumed, states[-1].done) == (1, 3)
    a, b, c = found.rows
    assert a == before.rows[0]
    assert [v.value for v in c.values] == [v.value for v in a.values]
    assert [v.value for v in b.values] != [v.value for v in a.values]


@pytest.mark.parametrize(
    ("of", "words"),
    [
        ([], "campaigns"),
        ("empty", "campaign.toml"),
        ("table.csv", r"table\.csv: .*'campaign'"),
        ("none.csv", r"none\.csv"),
        (ff.Laboratories("q3", 2), "q3"),
    ],
)
def test_nothing_to_do_is_refused(of: Any, words: str, tmp_path: Path) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "table.csv").write_text("path\na/campaign.toml\n")
    given = tmp_path / of if isinstance(of, str) else of
    with pytest.raises(ff.BadInput, match=words):
        ff.ensemble(given, out=tmp_path / "out")
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("count", "seed", "named"), [(0, 1, "count is 0"), (1, -1, "seed -1")], ids=["count", "seed"]
)
def test_impossible_numbers_of_laboratories_are_refused(count: int, seed: int, named: str) -> None:
    with pytest.raises(ff.BadInput, match=named):
        ff.Laboratories("q1", count, seed=seed)
