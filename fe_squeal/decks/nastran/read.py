"""From a Nastran deck to the draft of a scene."""

from __future__ import annotations

import re

import numpy as np

from ...mesh.building import build_mesh
from ...mesh.elements import SHAPE
from ...mesh.raw import CellBlock
from ...mesh.readers.nastran.coordinates import (
    OF_GRIDS,
    SYSTEMS,
    read_system,
    read_systems_of_grids,
    with_systems_of_grids,
)
from ...mesh.readers.nastran.deck import read_nastran
from ...mesh.readers.nastran.text import Card, read_cards, read_lines
from ...mesh.readers.sources import Sources
from ..draft import Draft, Value, Weight
from .cards import Deck
from .case import read_subcases, select
from .contacts import write_contacts
from .holding import find_held, write_supports
from .loads import write_effects
from .materials import clean, find_units, read_materials, write_bodies
from .parameters import in_case_control, read_parameters, write_damping
from .springs import write_springs
from .ties import find_ties, write_ties

_OF_REGION = 14  # field of EIGC with the number of modes of its first region
# How elements, rigid ones and matrices begin: where such a card is not known, the structure may be another one.
_STRUCTURE = re.compile("C(?!ORD)|RB|RJ|RS|K2|M2|B2|DMIG")
# What is left out, and what that means.
LEFT_OUT: dict[str, tuple[str, Weight]] = {
    "GRAV": ("gravity is not simulated", "changes"),
    **dict.fromkeys(("FORCE", "FORCE1", "MOMENT", "RFORCE", "TEMP", "TEMPD", "PLOAD", "PLOAD2", "SPCD"),
                    ("is a load that is not simulated: [effects.preload] takes pressures on surfaces", "changes")),
    **dict.fromkeys(("MPC", "MPCADD", "RBAR", "RBE1", "RROD", "RTRPLT", "RSPLINE", "CWELD", "CFAST", "CGAP"),
                    ("ties grid points and is not read: without it the structure is another one", "missing")),
    **dict.fromkeys(("CBAR", "CBEAM", "CROD", "CONROD", "CTUBE", "CBEND", "CBUSH1D", "CELAS3", "CELAS4"),
                    ("joins grid points and is not read: without it the structure is another one", "missing")),
    **dict.fromkeys(("CDAMP3", "CDAMP4", "CVISC"), ("is no solid and is left out, with its damping", "changes")),
    "PSHELL": ("names a material: shells are surfaces here, and their stiffness and mass are left out", "changes"),
    **dict.fromkeys(("CONM1", "CMASS1", "CMASS2", "CMASS3", "CMASS4"),
                    ("adds inertia that is left out: frequencies come out too high", "changes")),
    **dict.fromkeys(("MAT2", "MAT3", "MAT8", "MAT10", "MATHE", "MATS1"), ("this law is not simulated", "changes")),
    "DMIG": ("adds to the matrices of the structure, friction perhaps, and is not read", "missing"),
    **dict.fromkeys(("BGSET", "BCONP", "BCHANGE", "BCMOVE", "CONTACT", "TIE"),
                    ("contact: give [[contacts]] with surface, counterface, normal_stiffness and sliding", "missing")),
    "SUPORT": ("nothing has to be supported for modes of free bodies", "harmless"),
}  # fmt: skip
# What leaves the answer as it is, or belongs to the mesh.
SILENT = {
    "CORD1R", "CORD1C", "CORD1S",
    "CORD2R", "CORD2C", "CORD2S", "CTETRA", "CHEXA", "CPENTA", "CPYRAM", "CPYRA", "CTRIA3",
    "CTRIA6", "CTRIAR", "CQUAD4", "CQUAD8", "CQUADR", "CQUAD", "PLOTEL", "INCLUDE", "ENDDATA", "SET", "ASET",
    "ASET1", "EIGB", "MDLPRM", "DOPTPRM", "BCTPARM", "NLPARM", "NLPCI", "TSTEP", "DTI", "SPOINT",
}  # fmt: skip
BECOMES: dict[str, str] = {
    "MAT1, MAT9, MAT11": "`[materials.mat_N]`, where a property uses it; GE is `loss_factor`; MAT9 only orthotropic",
    "PSOLID": "`[bodies.NAME]`, by the name that the preprocessor's comments give; CORDM of CORD2R or CORD1R: `axes`",
    "SPC, SPC1, SPCADD": "`[[supports]]` of the set that the case control selects",
    "GRID, GRDSET": "PS: `[[supports]]`; CD turns what SPC, PS, CELAS and CDAMP do there: springs along any direction,"
    " supports where what they hold is along x, y and z; else they are asked for",
    "CELAS1, CELAS2, PELAS": "`[[springs]]`; GE is left out, and told",
    "CDAMP1, CDAMP2, PDAMP": "`[[springs]]` with `damping`",
    "CBUSH, PBUSH": "`[[springs]]` along the axes of CID; without CID alike in all directions, else asked for; GE and M"
    " are left out, and told",
    "RBE2": "`[[rigid]]`, with what acts on its grid point", "RBE3": "`[[averaged]]`, all with the same"
    " weight; what acts on freedoms of its grid point that REFC leaves out is left out",
    "CONM2": "`mass` and `inertia` at the reference of RBE2 and RBE3",
    "PLOAD4": "`[effects.preload] pressures` on the surface group PLOAD4_N; those along a direction of their own (N1 to"
    " N3) and on shells are left out, and told",
    "LOAD": "where the case control selects it, factors of the pressures of its sets of PLOAD4; other sets are left"
    " out, and told",
    "BSURF, BSURFS": "surface groups BSURF_N (shells, or all free faces of solids) and BSURFS_N",
    "BCTSET, BCTADD": "`[[contacts]]` with `mu`, of the sets that BCSET selects; stiffness, with 10 E/h as a"
    " suggestion, and motion are asked for",
    "BCTABLE, BCTABL1, BCONECT": "`[[contacts]]` likewise, of the table that BCONTACT selects; IGLUE: `tied`",
    "BCBODY, BCBODY1, BCONPRG, BCONPRP, BCBDPRP": "which BSURF a body is, IGLUE and FRIC; bodies of BCPROP, rigid"
    " bodies, and friction that is a table or stands at the bodies alone are asked for",
    "EIGRL, EIGR, EIGC": "`[solve] modes` or `max_frequency`, from the lowest: a lowest frequency or a shift point is"
    " told",
    "PARAM": "in bulk data and case control; WTMASS multiplies densities and masses, G is added to each `loss_factor`,"
    " ALPHA1 and ALPHA2 are `alpha` and `beta` of `[effects.rayleigh]`; all others are listed, but for those below",
}  # fmt: skip


def draft_nastran(sources: Sources, mesh_file: str) -> Draft:
    """Return the draft of the scene that a Nastran deck describes; the other parameters as of `draft_abaqus`.

    Raises
    ------
    MeshError
    """
    source = sources.path.name
    raw = read_nastran(sources)
    lines = list(read_lines(Sources(sources.path, sources.folders, sources.allow_outside)))
    cards: dict[str, list[Card]] = {}
    for card in read_cards(lines):
        cards.setdefault(card.name, []).append(card)
    if parameters := in_case_control(lines):
        cards["PARAM"] = cards.get("PARAM", []) + parameters
    cards["GRID"] = _with_defaults(cards["GRID"], cards.get("GRDSET", []))
    loaded = build_mesh(raw, source)
    draft = Draft(sources.path.stem)
    draft.head.append(f"Made by fe-squeal new from the Nastran deck {source}.")
    deck = Deck(source, cards, raw.node_labels, raw.points, _on_solids(raw.blocks, len(raw.points)), draft,
                select(read_subcases(lines), draft))  # fmt: skip
    of_grids = [read_systems_of_grids(card, deck.labels) for card in deck.of(*OF_GRIDS)]
    deck.systems = with_systems_of_grids(
        dict(read_system(card) for card in deck.of(*SYSTEMS)), {n: s for own in of_grids for n, s in own.items()},
        deck.points, np.zeros(len(deck.points), np.int64),
    )  # fmt: skip
    deck.turned = {deck.whole(card, 0): card for card in deck.of("GRID") if deck.whole(card, 5) > 0}
    read_parameters(deck)
    materials = read_materials(deck)
    find_units(deck, materials, float(np.ptp(loaded.mesh.p, axis=1).max()))
    mesh = draft.add("mesh", values={"file": mesh_file, "length_unit": deck.units.length_unit, "order": 2})
    linear = sum(len(block) for block in raw.blocks if block.kind == SHAPE[block.kind])
    if linear:
        mesh.notes["order"] = f"{linear} of the deck's elements are linear; order = 1 would keep them so, but locks"
    write_bodies(deck, loaded, materials)
    held, ties = find_held(deck), find_ties(deck)
    references: dict[int, list[dict[str, Value]]] = {grid: [] for grid in ties}
    write_supports(deck, held)
    write_springs(deck, held, references)
    write_ties(deck, ties, held, references)
    mu = write_contacts(deck, loaded, materials)
    write_effects(deck, raw.blocks, mu)
    if mu:
        draft.add_sweep(mu, "deck")
    write_damping(deck, materials)
    _write_solution(deck)
    for name, (text, weight) in LEFT_OUT.items():
        for card in [c for c in cards.get(name, []) if name != "PSHELL" or c.text(1)][:1]:
            draft.find(name, deck.where(card), text, weight)
    taken = {name.strip() for names in BECOMES for name in names.split(",")}
    for name in sorted(set(cards) - taken - set(LEFT_OUT) - SILENT):
        unknown: Weight = "missing" if _STRUCTURE.match(name) else "changes"
        draft.find(name, deck.where(cards[name][0]), "is not known here and is left out", unknown)
    return draft


def _with_defaults(grids: list[Card], defaults: list[Card]) -> list[Card]:
    """Return the cards GRID with CP, CD, PS and SEID of GRDSET where these are blank; 0 is not."""
    if not defaults:
        return grids
    filled = []
    for card in grids:
        fields = [*card.fields, *[""] * (8 - len(card.fields))]
        for i in (1, 5, 6, 7):
            fields[i] = fields[i] or defaults[-1].text(i)
        filled.append(Card(card.name, fields, card.where))
    return filled


def _on_solids(blocks: tuple[CellBlock, ...], count: int) -> np.ndarray:
    used = np.zeros(count, bool)
    for block in blocks:
        used[block.nodes[block.nodes >= 0]] = True
    return used


def _write_solution(deck: Deck) -> None:
    """Write the number of modes, or the highest frequency: of CMETHOD's EIGC or, where that has none, of METHOD.

    An EIGC without a number asks for as many complex modes as there are real ones.
    """
    values: dict[str, Value] = {}
    complex_ones, real_ones = deck.selected.get("CMETHOD", set()), deck.selected.get("METHOD", set())
    nothing = not complex_ones and not real_ones  # is selected: all cards count
    # Cards with what selects them and the fields of the number of modes, the highest and the lowest frequency or shift
    # point; EIGC may have its own below.
    places = [("EIGC", complex_ones, 6, -1, 9), ("EIGRL", real_ones, 3, 2, 1), ("EIGR", real_ones, 5, 3, 2)]
    for name, chosen, count, highest, lowest in [*places[1:], places[0]] if nothing else places:
        for card in deck.of(name):
            if not nothing and deck.whole(card, 0) not in chosen:
                continue
            number = card.text(count) or (card.text(_OF_REGION) if name == "EIGC" else "")
            if number.isdigit() and int(number):
                values = {"modes": int(number)}
            elif highest >= 0 and card.text(highest):
                values = {"max_frequency": clean(deck.number(card, highest) / deck.units.time)}
            if values:
                deck.draft.add("solve", values=values).comments.append(f"{name}, {deck.where(card)}")
                if deck.number(card, lowest) > 0:
                    text = f"asks for modes from {card.text(lowest)} on, or near it; here they begin with the lowest"
                    deck.find(card, f"{text}: raise modes")
                return
