"""Values of Ansys archives that depend on something, that come twice, and key options that keep contacts closed."""

from __future__ import annotations

import pytest
from selection import some
from test_decks_ansys_brake import brake, written

from fe_squeal.decks.scene import draft_of
from fe_squeal.errors import MeshError
from fe_squeal.mesh.readers.ansys_archive import Archive, read_apart
from fe_squeal.mesh.readers.ansys_faces import pressures

pytest.importorskip("mapdl_archive")
END = "MODOPT,QRDA,    12\n"


def drafted(tmp_path, *changes, **options):
    text = brake(**options)
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    return draft_of(written(tmp_path, text))


def material(draft, number):
    return next(t.values for t in draft.tables if t.path == ("materials", f"material_{number}"))


def values(draft, *path):
    return [t.values for t in draft.tables if t.path == path]


def told(draft):
    return [str(f) for f in draft.findings if f.weight != "harmless" and f.what not in ("ALPHAD", "BETAD")]


@pytest.mark.parametrize(("added", "sentence"), some([
    ("MPDATA,R5.0, 1,EX  ,       2, 1, 8000., 6000., 4000.,\n", "MPDATA,EX at line"),
    ("MPDATA,R5.0, 1,EX  ,       2, 1, 8000., 8000.,\nMPDATA,R5.0, 1,EX  ,       2, 7, 4000.,\n", "MPDATA,EX at line"),
    ("MP,EX,2,8000.,-3.\n", "MP,EX at line"),
], lambda added, sentence: sentence.startswith("MP,")))  # fmt: skip
def test_moduli_that_depend_on_temperature_are_told(tmp_path, added, sentence):
    draft = drafted(tmp_path, (END, added + END))
    assert material(draft, 2)["youngs_modulus"] == 8e9
    (line,) = told(draft)
    assert line.startswith(sentence) and "depends on temperature; 8000, the first value, is taken" in line


@pytest.mark.slow
def test_the_last_value_counts(tmp_path):
    draft = drafted(tmp_path, (END, "MP,EX,2,9000.\nMODOPT,QRDA,    30\n"))
    assert material(draft, 2)["youngs_modulus"] == 9e9 and values(draft, "solve") == [{"modes": 30}]
    assert not told(draft)


@pytest.mark.slow
@pytest.mark.parametrize(("table", "mu", "depends"), [
    ("TB,FRIC,3,1,1,ISO\nTBDATA,1,0.3\n", 0.3, False), ("TB,FRIC,3,1,2,ORTHO\nTBDATA,1,0.3,0.2\n", 0.3, True),
    ("TB,FRIC,3,2,1\nTBTEMP,20.\nTBDATA,1,0.3\nTBTEMP,200.\nTBDATA,1,0.2\n", 0.3, True),
    ("TB,FRIC,3\nTBDATA,1,0.3\nTB,FRIC,3\nTBDATA,1,0.2\n", 0.2, False),
])  # fmt: skip
def test_tables_of_friction(tmp_path, table, mu, depends):
    """A table counts before MU, and the last one before others."""
    draft = drafted(tmp_path, (END, table + END))
    assert values(draft, "effects", "friction") == [{"mu": mu}]
    assert [line.startswith("TB,FRIC at line") for line in told(draft)] == [True] * depends


@pytest.mark.slow
def test_a_law_of_the_user_is_asked_for(tmp_path):
    draft = drafted(tmp_path, (END, f"TB,FRIC,3,,,USER\n{END}"))
    assert any(line.startswith("TB,FRIC at line") for line in draft.missing)


@pytest.mark.slow
@pytest.mark.parametrize(("constants", "asked"), [
    ({"GXY": 700.0}, True), ({"GXY": 3200.0, "PRYZ": 0.25, "EY": 8e3}, False), ({"EY": 7e3}, True),
    ({"PRXZ": 0.1}, True),
])  # fmt: skip
def test_materials_that_are_not_isotropic_are_asked_for(tmp_path, constants, asked):
    added = "".join(f"MP,{key},2,{value}\n" for key, value in constants.items())
    assert any("orthotropic" in line for line in drafted(tmp_path, (END, added + END)).missing) == asked


@pytest.mark.slow
@pytest.mark.parametrize(("option", "lift_off"), [("KEYOP,       2,12,        4\n", False), ("", None)])
def test_contacts_without_separation_stay_closed(tmp_path, option, lift_off):
    (preload,) = values(drafted(tmp_path, option=option), "effects", "preload")
    assert preload.get("lift_off") == lift_off


@pytest.mark.slow
def test_no_separation_by_mpc_slides(tmp_path):
    draft = drafted(tmp_path, option="KEYOP,       2, 2,        2\nKEYOP,       2,12,        4\n")
    (contact,) = values(draft, "contacts")
    assert "kind" not in contact and contact["sliding"]["speed"] == 5.0


def test_laws_of_friction_among_real_constants_are_told(tmp_path):
    """TAUMAX is the 9th, FACT the 21st and DC the 22nd one; rows after the first have seven."""
    old = f"{-1500.0:16.8f}{0.1:16.8f}\n"
    row = [0.0] * 18
    row[4], row[16], row[17] = 12.0, 1.4, 0.05
    rest = "".join("".join(f"{v:16.8f}" for v in row[i : i + 7]) + "\n" for i in (2, 9, 16))
    new = f"{-1500.0:16.8f}{0.1:16.8f}{0.0:16.8f}{0.0:16.8f}\n{rest}"
    draft = drafted(tmp_path, ("       5       4", "       5      22"), (old, new))
    assert [line.split(":")[0] for line in told(draft)] == ["FACT", "TAUMAX"]
    assert "FACT = 1.4 and DC = 0.05" in told(draft)[0] and "12, is not simulated" in told(draft)[1]


MORE = "RMORE\nRMORE,,,,,,\nRMORE,,,1.4,0.05\n"  # constants 7 to 24, of which FACT is the 21st and DC the 22nd one


@pytest.mark.parametrize(("constants", "told_of"), some([
    (f"R,5,,,-3000.\n{MORE}", "FACT = 1.4 and DC = 0.05"), ("R,R5.0,5,LOC,3,-3000.\n", ""),
    (f"R,5,1.,,-3000.\n{MORE}R,5,,,-3000.\n", ""),
], lambda constants, told_of: told_of))  # fmt: skip
def test_real_constants_by_commands(tmp_path, constants, told_of):
    """R gives the constants 1 to 6 and begins a set anew, RMORE the next six each time; CDWRITE gives up to three."""
    text = brake().split("RLBLOCK")[0] + constants + "R,6,1.5E-4,1.5E-4,1.5E-4,0.2,0.3,0.4\nNBLOCK"
    new, old = (draft_of(written(tmp_path, t)) for t in (text + brake().split("NBLOCK")[1], brake(fkn=-3000.0)))
    assert [t.values for t in new.tables] == [t.values for t in old.tables]
    assert [line for line in told(new)] == [line for line in told(new) if told_of and told_of in line]
    assert bool(told(new)) == bool(told_of)


@pytest.mark.parametrize("line", some(["R,5,stiff", "R,pair,1.", "RMORE,1.,2.", "R,R5.0,5,LOC,0,1.",
                                       "R,UNBL,5,LOC,999999999,1."],
                                      lambda line: line == "RMORE,1.,2."))  # fmt: skip
def test_real_constants_that_cannot_be_read_are_refused(tmp_path, line):
    with pytest.raises(MeshError, match=f'brake.cdb: line .*"{line.upper()}" gives no real constants'):
        drafted(tmp_path, ("RLBLOCK", f"{line}\nRLBLOCK"))


@pytest.mark.slow
def test_modes_that_are_not_the_lowest_are_told(tmp_path):
    draft = drafted(tmp_path, (END, "MODOPT,QRDA,    12, 500., 9000.\n"))
    assert any(line.startswith("MODOPT at line") and "from 500. on" in line for line in told(draft))


@pytest.mark.parametrize(("value", "asked"), [(1, True), pytest.param(0, False, marks=pytest.mark.slow)])
def test_solids_of_layers_are_asked_for(tmp_path, value, asked):
    draft = drafted(tmp_path, option=f"KEYOP,       1, 3,        {value}\n")
    assert any("solids of type 1 are of layers" in line for line in draft.missing) == asked


@pytest.mark.slow
@pytest.mark.parametrize("command", ["SFEDELE,ALL,ALL,PRES", "DDELE,5,UX", "MPCHG,2,ALL", "EKILL,3"])
def test_commands_that_change_what_stands_before_are_asked_for(tmp_path, command):
    draft = drafted(tmp_path, (END, f"{command}\n{END}"))
    assert any(line.startswith(command.partition(",")[0]) for line in draft.missing)


@pytest.mark.slow
def test_pressures_that_differ_from_corner_to_corner_are_told(tmp_path):
    assert not told(drafted(tmp_path))
    old, new = f"{1.5:16.8f}  {0:16.8f}", f"{1.5:16.8f}  {2.5:16.8f}"
    draft = drafted(tmp_path, (old, new))
    assert any(line.startswith("SFE at line") and "the mean is taken" in line for line in told(draft))


def test_faces_of_tetrahedra_have_three_corners(tmp_path):
    """The mean of 3, 3, 3 and no fourth one is 3, and that of a hexahedron of 3, 3, 3 and 0 is 2.25."""
    whole = read_apart(written(tmp_path, brake()))
    lines = ["SFE,1,2,PRES,1,R5.0", "  3.  3.  3.  0."]
    for kind, mean in ((187, 3.0), (185, 2.25)):
        types = whole.ekey.copy()
        types[types[:, 0] == 1, 1] = kind
        archive = Archive(whole.nnum, whole.nodes, whole.angles, types, whole.elem, {}, {}, {})
        assert list(pressures(archive, lines, "a.cdb")) == [mean]


def test_recent_archives_name_no_release(tmp_path):
    """UNBL stands where the number of a release, such as R5.0, stood before."""
    old, new = (drafted(tmp_path, *changes) for changes in ((), (("R5.0", "UNBL"), ("R5.3", "UNBL"))))
    assert new.text() == old.text() and values(new, "effects", "preload")[0]["pressures"] == {"pressure_1": 1.5e6}


def in_blocks(text, options=()):
    """Return an archive with ETBLOCK, DBLOCK and SFEBLOCK in place of ET, D and SFE, with (type, number, value)."""
    given = {(kind, number): value for kind, number, value in options}
    types, held, loads, rest = "", "", "", []
    lines = iter(text.splitlines())
    for line in lines:
        fields = line.split(",")
        if fields[0] == "ET":
            cells = [*fields[1:], *(given.get((int(fields[1]), k), 0) for k in range(1, 19)), 0]
            types += "".join(f"{int(cell):9d}" for cell in cells) + "\n"
            rest += ["ETBLOCK"] * (not any(line == "ETBLOCK" for line in rest))
        elif fields[0] == "D":
            held += f"{int(fields[1]):9d}{fields[2].strip():6s}{0.0:16.9E}{0.0:16.9E}\n"
        elif fields[0] == "SFE":
            loads += f"{int(fields[1]):9d}{int(fields[2]):4d}{int(fields[4]):4d}"
            loads += "".join(f"{float(value):20.9E}" for value in next(lines).split()) + "\n"
        else:
            rest.append(line)
    whole = "\n".join(rest).replace("ETBLOCK", f"ETBLOCK,        4,        4\n(2i9,19a9)\n{types}       -1")
    blocks = f"DBLOCK,{held.count(chr(10)):9d}\n(i9,a6,2(pg16.9))\n{held}       -1\n"
    blocks += f"SFEBLOCK,4,PRES,{13:9d},{12:9d},0\n(i9,i4,i4,6(pg20.9))\n{loads}SFE,end,LOC,       -1,\n"
    return whole.replace("ALPHAD", f"{blocks}ALPHAD") + "\n"


@pytest.mark.parametrize("options", some([
    [], [(2, 12, 5)], [(2, 12, 4)], [(2, 2, 2)], [(1, 3, 1)], [(4, 3, 2)],
], lambda options: options == [(2, 12, 5)]))  # fmt: skip
def test_blocks_are_the_commands_of_their_rows(tmp_path, options):
    """Contacts that are bonded, without separation and by MPC, solids of layers, and masses without inertia."""
    old = draft_of(written(tmp_path, brake(option="".join(f"KEYOP,{k},{n},{v}\n" for k, n, v in options))))
    text = in_blocks(brake(), options)
    assert not any(line.startswith(("ET,", "D,", "KEYOP")) for line in text.splitlines())
    new = draft_of(written(tmp_path, text))
    assert [t.values for t in new.tables] == [t.values for t in old.tables]
    assert [(f.what, f.text) for f in new.findings] == [(f.what, f.text) for f in old.findings]


def test_later_key_options_count_before_those_of_etblock(tmp_path):
    text = in_blocks(brake(), [(2, 12, 5)]).replace("RLBLOCK", "KEYOP,       2,12,        0\nRLBLOCK")
    (contact,) = values(draft_of(written(tmp_path, text)), "contacts")
    assert "kind" not in contact


def test_key_options_in_et_itself(tmp_path):
    """ET has the first six as fields of its own; one of KEYOP behind it counts before them."""
    (by_mpc,) = values(drafted(tmp_path, ("ET,2,174", "  et,2,CONTA174,,2")), "contacts")
    assert by_mpc["kind"] == "tied"
    (sliding,) = values(drafted(tmp_path, ("ET,2,174", "ET,2,174,,2\nKEYOP,2,2,0")), "contacts")
    assert "kind" not in sliding


def test_types_of_mapdl_archive_itself_are_read(tmp_path):
    """It writes the rows of ETBLOCK with single blanks, whatever the format says."""
    head = "ETBLOCK,        4,        4\n(2i9,19a9)\n"
    text = in_blocks(brake(), [(2, 12, 5)])
    rows = text.split(head)[1].split("       -1\n")[0]
    loose = "".join(f"{int(r[:9]):9d} {int(r[9:18]):3d} {' '.join(r[18:].split())} 0\n" for r in rows.splitlines())
    (contact,) = values(draft_of(written(tmp_path, text.replace(rows, loose))), "contacts")
    assert contact["kind"] == "tied"


@pytest.mark.parametrize(("block", "weight"), some([
    ("FBLOCK,2\n(i9,a6,2(pg16.9))\n        1FX      1.0             0.0\n       -1\n", "changes"),
    ("SFBLOCK,2\n       -1\n", "changes"), ("CEBLOCK,2\n       -1\n", "missing"),
    ("CPBLOCK,2\n       -1\n", "missing"), ("XYBLOCK,2\n       -1\n", "missing"),
    ("DBLOCK,1\n(i10,a6,2(pg16.9))\n         1UX     0.0             0.0\n       -1\n", "missing"),
    ("DBLOCK,1\n(i9,a6,2(pg16.9))\n        1UX     0.0             0.0\n", "missing"),
], lambda block, weight: block[:2] in ("FB", "XY")))  # fmt: skip
def test_blocks_that_are_not_read_are_listed(tmp_path, block, weight):
    """Those of columns that are not known, and without an end, too."""
    (finding,) = [f for f in drafted(tmp_path, (END, block + END)).findings if "BLOCK" in f.what]
    assert block.startswith(f"{finding.what},") and finding.weight == weight


@pytest.mark.parametrize("line", some([
    "MPDATA,BETD,2,1,2.E-6", "MPDATA,R5.0, 1,DAMP,       2, 1, 2.E-6,", "MP,DAMP,2,2.E-6",
], lambda line: "R5.0" in line))  # fmt: skip
def test_older_names_and_forms_of_values_are_read(tmp_path, line):
    draft = drafted(tmp_path, (END, f"{line}\nMPDATA,MU,3,1,0.25\n{END}"))
    (damped,) = [t.values["rayleigh"] for t in draft.tables if t.path == ("bodies", "material_2")]
    assert damped["beta"] == pytest.approx(2e-6 + 1e-7)
    assert values(draft, "effects", "friction") == [{"mu": 0.25}]


def test_damping_of_the_whole_stiffness_is_told_where_there_are_contacts(tmp_path):
    (finding,) = [f for f in drafted(tmp_path).findings if f.what == "BETAD"]
    assert "damps contacts" in finding.text


@pytest.mark.slow
def test_a_contact_from_both_sides_is_one(tmp_path):
    """Workbench writes the pair and its mirror, of which KEYOPT(8) = 2 lets one act."""
    text = brake()
    rows = [line for line in text.splitlines() if line[9:27].split() in (["2", "5"], ["3", "5"])]
    head = text.split("EBLOCK,19,SOLID,")[1].split("\n")[0]
    last, count = (int(number) for number in head.split(","))
    mirror = "".join(
        f"{row[:9]}{5 - int(row[9:18]):9d}{7:9d}{row[27:90]}{last + i:9d}{row[99:]}\n" for i, row in enumerate(rows, 1)
    )
    text = text.replace("       -1\nCMBLOCK", f"{mirror}       -1\nCMBLOCK")
    text = text.replace(head, f"{last + len(rows):9d},{count + len(rows):9d}")
    for option, count in (("", 2), ("KEYOP,       2, 8,        2\n", 1)):
        draft = draft_of(written(tmp_path, text.replace("RLBLOCK", f"{option}RLBLOCK")))
        assert len(values(draft, "contacts")) == count
    assert any(f.what == "KEYOPT(8)" for f in draft.findings)
