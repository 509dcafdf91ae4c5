"""What a run writes: every file and column of the interface."""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scene_texts import (
    CRITICAL_MU,
    TABLES_AND_FIGURES,
    environment,
    growth_of_rigid_block,
    read_rows,
    replaced,
    write_scene,
)

from fe_squeal.cli import main
from fe_squeal.eigen.memory import TooLargeError

MODES = (
    "parameter,value,mode,branch,re,im,frequency_hz,damping_ratio,stability,noise,backward_error,re_uncertainty,"
    "re_discretisation,im_discretisation,"
    "nodal_diameters,nodal_circles,out_of_plane,body,body_share,"
    "nodal_diameters_share,other_nodal_diameters,other_share,travelling"
)
ONSETS = (
    "parameter,value,frequency_hz,kind,direction,crossing_speed,branch_a,branch_b,uncertainty,two_mode_value,"
    "discretisation,law"
)
CONTRIBUTIONS = "parameter,value,mode,branch,term,re_share,energy_share,energy"
SENSITIVITIES = "parameter,value,mode,branch,number,at,dre,dim"


@pytest.fixture(scope="module")
def out(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The results of the block, with shapes of its unstable mode."""
    folder = tmp_path_factory.mktemp("run")
    path = write_scene(folder, replaced('shapes = "none"', 'shapes = "unstable"'))
    assert main(["run", str(path), "-o", str(folder / "out")]) == 0
    return folder / "out"


def header(path: Path) -> str:
    return path.read_text(encoding="utf-8").split("\n", 1)[0]


def test_files(out: Path) -> None:
    assert {p.name for p in out.iterdir()} == TABLES_AND_FIGURES | {"shapes"}
    assert header(out / "modes.csv") == MODES
    assert header(out / "onsets.csv") == ONSETS
    assert header(out / "contributions.csv") == CONTRIBUTIONS
    assert header(out / "sensitivities.csv") == SENSITIVITIES
    for figure in ("stability.png", "root_locus.png", "contributions.png"):
        content = (out / figure).read_bytes()
        assert content.startswith(b"\x89PNG\r\n\x1a\n") and len(content) > 10_000


def test_modes(out: Path) -> None:
    rows = read_rows(out / "modes.csv")
    values = sorted({float(r["value"]) for r in rows})
    assert values == pytest.approx([0.0, 0.2, 0.4, 0.6, 0.8])
    for value in values:
        here = [r for r in rows if float(r["value"]) == value]
        assert [int(r["mode"]) for r in here] == list(range(1, 9))
        assert np.all(np.diff([float(r["im"]) for r in here]) >= 0)
        assert len({int(r["branch"]) for r in here}) == 8
    for r in rows:
        lam, uncertainty = complex(float(r["re"]), float(r["im"])), float(r["re_uncertainty"])
        assert r["parameter"] == "mu"
        assert float(r["frequency_hz"]) == pytest.approx(lam.imag / (2 * np.pi), rel=1e-14)
        assert float(r["damping_ratio"]) == pytest.approx(-lam.real / abs(lam), rel=1e-14)
        word = "unstable" if lam.real > uncertainty else "stable" if lam.real < -uncertainty else "marginal"
        assert r["stability"] == word
        assert r["noise"] == ("moan" if word == "unstable" else "")  # near 700 Hz
        assert 0 <= float(r["backward_error"]) <= 1e-8
        assert (r["re_discretisation"], r["im_discretisation"]) == ("", "")
        assert (r["body"], r["nodal_diameters"], r["nodal_circles"]) == ("block", "", "")  # a belt has no axis
        assert float(r["body_share"]) == pytest.approx(1.0) and 0.0 <= float(r["out_of_plane"]) <= 1.0


def test_growth_is_that_of_the_minimal_model(out: Path) -> None:
    """The elastic block beside the rigid one: pitch and elasticity change some 0.1 % of it."""
    rows = read_rows(out / "modes.csv")
    unstable = {round(float(r["value"]), 9): float(r["re"]) for r in rows if r["stability"] == "unstable"}
    assert sorted(unstable) == [0.6, 0.8]
    for mu, growth in unstable.items():
        assert growth == pytest.approx(growth_of_rigid_block(mu), rel=5e-3)


def test_onsets(out: Path) -> None:
    (onset,) = read_rows(out / "onsets.csv")
    assert float(onset["value"]) == pytest.approx(CRITICAL_MU, rel=5e-3)
    assert float(onset["two_mode_value"]) == pytest.approx(CRITICAL_MU, rel=5e-3)
    assert (onset["parameter"], onset["kind"], onset["direction"]) == ("mu", "flutter", "into")
    assert (onset["discretisation"], onset["law"]) == ("", "root")
    unstable = {r["branch"] for r in read_rows(out / "modes.csv") if r["stability"] != "marginal"}
    assert {onset["branch_a"], onset["branch_b"]} == unstable
    # Re λ ≈ sqrt(COUPLING CONTACT (μ − μc)) / (2 m ω) near the onset.
    assert float(onset["crossing_speed"]) == pytest.approx(growth_of_rigid_block(0.401) / np.sqrt(0.001), rel=0.01)
    assert 0 < float(onset["uncertainty"]) < 1e-6


def shares_add_up(folder: Path) -> list[str]:
    """Assert that the shares of each unstable mode add up to its `sum` and to Re λ in modes.csv; return the terms.

    Re λ is a small part of |λ| and comes with rounding of 1e-16 |λ| times the condition of the mode: 1e-9 |λ| is safe.
    """
    modes = {(r["value"], r["mode"], r["branch"]): r for r in read_rows(folder / "modes.csv")}
    shares: dict[tuple[str, str, str], dict[str, float]] = {}
    for r in read_rows(folder / "contributions.csv"):
        shares.setdefault((r["value"], r["mode"], r["branch"]), {})[r["term"]] = float(r["re_share"])
    assert set(shares) == {key for key, r in modes.items() if r["stability"] == "unstable"}
    for key, terms in shares.items():
        size = abs(complex(float(modes[key]["re"]), float(modes[key]["im"])))
        total = sum(share for term, share in terms.items() if term != "sum")
        assert abs(total - terms["sum"]) <= 1e-9 * size
        assert abs(terms["sum"] - float(modes[key]["re"])) <= 1e-9 * size
    return sorted({term for terms in shares.values() for term, share in terms.items() if share})


def test_contributions(out: Path) -> None:
    assert shares_add_up(out) == ["friction.belt", "sum"]


def test_record(out: Path) -> None:
    record = json.loads((out / "run.json").read_text(encoding="utf-8"))
    kinds = {
        "version": str, "title": str, "scene": str, "status": str, "unknowns": int, "problem_class": str,
        "effects": list, "method": str, "linear_solver": str, "seconds": dict, "peak_memory_mib": float,
        "completeness": dict, "warnings": list,
    }  # fmt: skip
    assert {key: type(record[key]) for key in kinds} == kinds
    assert record["title"] == "block on a belt"
    assert record["scene"].endswith("block.toml")
    assert (record["status"], record["unknowns"], record["problem_class"]) == ("complete", 90, "nonsymmetric")
    assert record["effects"] == ["friction"]
    assert record["completeness"] == {"found": 8, "expected": 8, "proven": True}
    stages = record["seconds"]
    assert {"assembly", "eigenvalues", "total"} <= set(stages)
    assert all(isinstance(s, float) and s >= 0 for s in stages.values())
    assert stages["total"] >= sum(s for stage, s in stages.items() if stage != "total") * 0.999
    assert record["warnings"] == []


def test_shapes(out: Path) -> None:
    import pyvista

    (file,) = (out / "shapes").glob("*.vtu")
    shape = pyvista.read(file)
    assert {"u_re", "u_im", "amplitude"} <= set(shape.point_data)
    u = shape.point_data["u_re"] + 1j * shape.point_data["u_im"]
    assert u.shape == (30, 3)
    # The rigid block's flutter mode: x and z alike in size, almost nothing across.
    size = np.sqrt((np.abs(u) ** 2).mean(axis=0))
    assert size[0] == pytest.approx(size[2], rel=0.05)
    assert size[1] < 0.05 * size[0]
    assert np.all(shape.point_data["amplitude"] <= np.linalg.norm(np.abs(u), axis=1) * (1 + 1e-12))
    assert file.with_suffix(".pvd").exists()
    assert file.with_suffix(".png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.slow
def test_all_shapes_of_the_last_value(tmp_path: Path, no_figures: None) -> None:
    text = replaced("from = 0.0\nto = 0.8\npoints = 5", "values = [0.0, 0.7]").replace('"none"', '"all"')
    assert main(["run", str(write_scene(tmp_path, text)), "-o", str(tmp_path / "out")]) == 0
    rows = [r for r in read_rows(tmp_path / "out" / "modes.csv") if r["value"] == "0.7"]
    files = sorted(p.name for p in (tmp_path / "out" / "shapes").glob("*.vtu"))
    assert len(rows) == len(files) == 8
    branches = sorted(int(re.match(r"branch_(\d+)_mu_0.70_", name)[1]) for name in files)  # type: ignore[index]
    assert branches == sorted(int(r["branch"]) for r in rows)


@pytest.mark.slow
def test_figures_are_there_though_no_shape_can_be(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A shape of a large problem may take more memory than there is; the run ends with that message."""
    import fe_squeal.run.outputs

    def fails(*given: object) -> None:
        raise TooLargeError("no room for a shape")

    monkeypatch.setattr(fe_squeal.run.outputs, "_shapes", fails)
    text = replaced('"none"', '"unstable"')
    assert main(["run", str(write_scene(tmp_path, text)), "-o", str(tmp_path / "out")]) != 0
    for name in ("stability.png", "root_locus.png", "contributions.png"):
        assert (tmp_path / "out" / name).read_bytes().startswith(b"\x89PNG")
    assert len(read_rows(tmp_path / "out" / "modes.csv")) > 0


@pytest.mark.slow
def test_damped_run(tmp_path: Path) -> None:
    """A damper makes the problem quadratic and takes a share; no sweep: one value, the nominal one."""
    text = replaced('name = "across"', 'name = "across"\ndamping = 50.0')
    text = replaced('name = "normal_1"', 'name = "normal_1"\ndamping = 20.0', text)
    text = replaced("mu = 0.3", "mu = 0.8", text)
    text = text[: text.index("[sweep]")] + text[text.index("[solve]") :]
    assert main(["run", str(write_scene(tmp_path, text)), "-o", str(tmp_path / "out")]) == 0
    assert json.loads((tmp_path / "out" / "run.json").read_text())["problem_class"] == "quadratic"
    terms = shares_add_up(tmp_path / "out")
    assert {"friction.belt", "spring.normal_1", "sum"} <= set(terms)
    rows = read_rows(tmp_path / "out" / "modes.csv")
    assert {r["value"] for r in rows} == {"0.8"}
    assert {"unstable", "stable"} <= {r["stability"] for r in rows}
    assert read_rows(tmp_path / "out" / "onsets.csv") == []


@pytest.mark.slow
def test_no_mode_in_the_range_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The lowest mode is at 697 Hz: an empty table must not pass for a stable brake."""
    path = write_scene(tmp_path, replaced("modes = 8", "max_frequency = 100.0"))
    assert main(["run", str(path), "-o", str(tmp_path / "out")]) == 0
    sentence = "solve.max_frequency: given 100 Hz; no mode lies below it"
    assert f"warning: {sentence}" in capsys.readouterr().out
    assert json.loads((tmp_path / "out" / "run.json").read_text())["warnings"][0].startswith(sentence)
    assert header(tmp_path / "out" / "modes.csv") == MODES


@pytest.mark.slow
def test_light_run_imports_no_pictures_and_no_mesher(tmp_path: Path) -> None:
    """On a ready mesh and with shapes = "none", neither gmsh nor pyvista is loaded, also with a page."""
    text = replaced("from = 0.0\nto = 0.8\npoints = 5", "values = [0.3]")
    write_scene(tmp_path, replaced("report = false", "report = true", text))
    program = (
        "import sys; from fe_squeal.cli import main; code = main(['run', 'block.toml']);"
        "print(code, [m for m in ('gmsh', 'pyvista', 'vtk', 'vtkmodules') if m in sys.modules])"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, encoding="utf-8", env=environment(), cwd=tmp_path,
        timeout=60,
    )  # fmt: skip
    assert done.stdout.splitlines()[-1] == "0 []"
    assert {p.name for p in (tmp_path / "block_results").iterdir()} == TABLES_AND_FIGURES | {"report.html"}
    assert "results in block_results: report.html, stability.png, root_locus.png (" in done.stdout
