"""What each keyword of an Abaqus deck becomes; of those that are not taken over, what leaving them out means."""

from __future__ import annotations

from collections.abc import Callable

from ...mesh.readers.abaqus.model import Statement
from ..draft import Weight
from .amplitudes import read_amplitude, read_static
from .contacts import INTERACTION_SUBOPTIONS, read_behaviour, read_interaction, read_pair
from .content import Content
from .equations import read_equation
from .friction import read_change_friction, read_friction
from .general import read_assignment, read_exclusions, read_inclusions
from .holding import read_boundary, read_spring
from .masses import read_mass
from .materials import SUBOPTIONS, read_material, read_suboption
from .motions import read_motion
from .orientations import read_orientation
from .steps import end_step, read_face_load, read_force, read_frequency, read_step, read_surface_load
from .ties import read_coupling, read_kind, read_mpc, read_old_coupling, read_rigid_body
from .transforms import read_transform


def _keep(name: str) -> Callable[[Content, Statement], None]:
    def read(content: Content, statement: Statement) -> None:
        getattr(content, name).append(statement)

    return read


HANDLERS: dict[str, Callable[[Content, Statement], None]] = {
    "MATERIAL": read_material, **dict.fromkeys(SUBOPTIONS, read_suboption),
    "SOLID SECTION": _keep("sections"), "ORIENTATION": read_orientation,
    "BOUNDARY": read_boundary, "TRANSFORM": read_transform, "SPRING": read_spring, "DASHPOT": read_spring,
    "SURFACE INTERACTION": read_interaction, "CHANGE FRICTION": read_change_friction, "FRICTION": read_friction,
    "SURFACE BEHAVIOR": read_behaviour, "CONTACT PAIR": read_pair, "TIE": read_pair, "MOTION": read_motion,
    "CONTACT INCLUSIONS": read_inclusions, "CONTACT EXCLUSIONS": read_exclusions,
    "CONTACT PROPERTY ASSIGNMENT": read_assignment,
    "STEP": read_step, "END STEP": end_step, "STATIC": read_static, "AMPLITUDE": read_amplitude,
    "DSLOAD": read_surface_load, "DLOAD": read_face_load, "CLOAD": read_force,
    "COUPLING": read_coupling, "KINEMATIC": read_kind, "DISTRIBUTING": read_kind, "MPC": read_mpc,
    "KINEMATIC COUPLING": read_old_coupling, "DISTRIBUTING COUPLING": read_old_coupling, "RIGID BODY": read_rigid_body,
    "EQUATION": read_equation, "MASS": read_mass, "ROTARY INERTIA": read_mass,
    "FREQUENCY": read_frequency, "COMPLEX FREQUENCY": read_frequency,
}  # fmt: skip

# What each of them becomes, for docs/decks.md.
BECOMES: dict[str, str] = {
    "*Material": "`[materials.NAME]`, where a section uses it",
    "*Elastic": "isotropic, `ENGINEERING CONSTANTS` and `ORTHOTROPIC`: `youngs_modulus`, `poisson_ratio`,"
    " `shear_modulus`; of rows by temperature the first",
    "*Density": "`density`", "*Damping": "`ALPHA`, `BETA`: `rayleigh` of the bodies; `STRUCTURAL`: `loss_factor` and"
    " `[effects.structural_damping]`",
    "*Solid Section": "`[bodies.NAME]`, one for each instance; of trusses and the like left out, and told",
    "*Orientation": "rectangular, by coordinates: `axes` of bodies of orthotropic materials, directions of springs"
    " and `*Rotary Inertia`; those of a part belong to it alone and turn with each of its instances",
    "*Boundary": "`[[supports]]`: ranges of freedoms, `ENCASTRE`, `PINNED`, symmetries; node sets and single nodes, in"
    " assembly, instance and part; `OP=NEW` lets go of what earlier steps hold",
    "*Transform": "axes of `*Boundary` at solids and reference nodes, turned with their instance, where what it holds"
    " is along x, y and z; else it is asked for",
    "*Spring, *Dashpot": "`[[springs]]` of SPRING1, SPRING2, SPRINGA and DASHPOT1, 2, A; between a solid and a node"
    " that is held: to ground",
    "*Contact Pair": "`[[contacts]]`; the side that `*Motion` moves is the counterface, whichever is slave;"
    " `TIED`: as `*Tie`; a distance under `ADJUST`: `gap_tolerance`",
    "*Contact Inclusions, *Contact Exclusions, *Contact Property Assignment": "`[[contacts]]` of the pairs that are"
    " named and not excluded; of all others that touch they are asked for",
    "*Surface": "surface groups; `COMBINE=UNION` of others; other combinations, `CROP` and analytical surfaces are"
    " refused where something acts on them",
    "*Surface Interaction": "for its pairs",
    "*Friction": "`mu` of the first row, of `EXPONENTIAL DECAY` and tables of slip rates that at the mean sliding speed"
    " where `*Motion` gives it, told with dmu/dv; the largest is `[effects.friction] mu`, others are `friction_ratio`;"
    " `ROUGH`: tied; `ANISOTROPIC`: the first of the two, and told; `TAUMAX` is left out, and told",
    "*Change Friction": "the last `*Friction` counts, after `RESET` that of the interaction; an `AMPLITUDE` that does"
    " not end at 1 is asked for",
    "*Surface Behavior": "`PRESSURE-OVERCLOSURE=LINEAR`: `normal_stiffness`; of other kinds it is asked for, with a"
    " suggestion; `NO SEPARATION` of all contacts: `lift_off = false` of a preload",
    "*Tie": "a contact of `kind = \"tied\"` with 100 E/h of the softer side; `POSITION TOLERANCE`:"
    " `gap_tolerance`; `TIED NSET` is asked for",
    "*Coupling, *Kinematic, *Kinematic Coupling": "`[[rigid]]`, with what acts on the reference node: `*Boundary`,"
    " springs, `*Mass`, `*Rotary Inertia`; `INFLUENCE RADIUS` is asked for where it leaves out nodes",
    "*Distributing, *Distributing Coupling": "`[[averaged]]`, all of the surface or all nodes with the same"
    " weight; what acts on rotations that the data lines release is left out",
    "*Equation": "`[[averaged]]` where a node of its own follows the mean of three or more nodes, all with the same"
    " weight, in a direction; others are asked for",
    "*Rigid Body": "`[[rigid]]` of node sets; `POSITION=CENTER OF MASS` is asked for",
    "*MPC": "of type BEAM: `[[rigid]]`",
    "*Mass, *Rotary Inertia": "`mass` and `inertia` at reference nodes, summed; elsewhere left out, and told, as is"
    " damping of a mass; `TYPE=ANISOTROPIC` is asked for",
    "*Motion": "`sliding`: `ROTATION` about an axis, or a velocity; where both sides move, that of one against the"
    " other",
    "*Amplitude": "of loads and `*Motion`, tables over the time of the step: what they are at its end is a factor;"
    " others are asked for",
    "*Static": "how long a step takes, for `*Amplitude`; so of `*Visco`, `*Dynamic` and other steps in time",
    "*Dsload": "`[effects.preload] pressures`, as they are at the end of the steps before the frequencies that count;"
    " `OP=NEW` removes those of `*Dsload` alone, of earlier steps",
    "*Dload": "of P1 to P6: pressures on surfaces DLOAD_SET_P3, of single elements DLOAD_2_1; others are left out",
    "*Cload": "a pressure of the same sum, where it acts along the normal of a face: on all its nodes, or through its"
    " middle on the reference node of its coupling; else left out, and told",
    "*Frequency, *Complex Frequency": "`[solve] modes` or `max_frequency`, from the lowest: a lowest"
    " frequency or a shift point is told, by the fields of its `EIGENSOLVER`; `FRICTION DAMPING=YES`:"
    " `[effects.friction_damping]`; `PROPERTY EVALUATION` changes nothing here: it is for materials and springs that"
    " depend on the frequency, and structural damping is that of each mode's own",
    "*Step": "`PERTURBATION`: its loads are no preload; `NLGEOM` with a preload: a note",
    "*Parameter": "numbers and arithmetic, put in where `<name>` stands", "*Include": "within the deck's folder",
}  # fmt: skip

_APART = "ties parts together or to reference nodes and is not read: without it the structure is another one"
_SHELLS = "is for elements that are no solids; they are left out, with their stiffness and mass"
_LOAD = "is a load that is not simulated: the static state has only what [effects.preload] says"
_TIES = ("EMBEDDED ELEMENT", "FASTENER", "SHELL TO SOLID COUPLING", "CONNECTOR SECTION")
_MATRICES = ("MATRIX INPUT", "MATRIX ASSEMBLE", "USER ELEMENT", "UEL PROPERTY", "SUBSTRUCTURE PROPERTY")
_NO_SOLIDS = ("SHELL SECTION", "SHELL GENERAL SECTION", "BEAM SECTION", "BEAM GENERAL SECTION", "MEMBRANE SECTION",
              "CONNECTOR BEHAVIOR", "CONNECTOR ELASTICITY", "CONNECTOR DAMPING", "GASKET SECTION",
              "COHESIVE SECTION", "SURFACE SECTION")  # fmt: skip
_LOADS = ("TEMPERATURE", "FIELD", "BASE MOTION", "INERTIA RELIEF", "PRE-TENSION SECTION", "CLEARANCE",
          "FIXED INTERFERENCE", "CONTACT INTERFERENCE")  # fmt: skip
# What is left out, and what that means.
LEFT_OUT: dict[str, tuple[str, Weight]] = {
    **dict.fromkeys(_TIES, (_APART, "missing")), **dict.fromkeys(_NO_SOLIDS, (_SHELLS, "changes")),
    "NONSTRUCTURAL MASS": ("adds inertia that is left out: frequencies come out too high", "changes"),
    **dict.fromkeys(_LOADS, (_LOAD, "changes")),
    "INITIAL CONDITIONS": ("temperatures, stresses and velocities at the start are not simulated", "changes"),
    "CONTACT DAMPING": ("give normal_damping in [[contacts]], N s/m per m^2", "changes"),
    "CYCLIC SYMMETRY MODEL": ("a sector does not stand for the whole here; mesh the whole", "missing"),
    "SUBSTRUCTURE PATH": ("substructures are not read", "missing"),
    **dict.fromkeys(_MATRICES, ("adds stiffness and mass that are not read: the structure is another one", "missing")),
    "MODEL CHANGE": ("parts and contacts that are taken out later are simulated throughout", "changes"),
    "MODAL DAMPING": ("modal damping has no equivalent; give Rayleigh or structural damping", "changes"),
    "GLOBAL DAMPING": ("give [effects.rayleigh] or [effects.structural_damping]", "changes"),
    "HOURGLASS STIFFNESS": ("elements are integrated in full and need none", "harmless"),
    "SECTION CONTROLS": ("elements are integrated in full and need none", "harmless"),
}  # fmt: skip
# Steps of other kinds, whose data begin with the first increment and the time that the step takes, as those of *Static.
_TIMED_STEPS = {"DYNAMIC", "HEAT TRANSFER", "COUPLED TEMPERATURE-DISPLACEMENT", "VISCO", "STEADY STATE TRANSPORT"}
# These are linear perturbations whether *Step says so or not: what is loaded in them is no preload.
_PERTURBATIONS = {"STEADY STATE DYNAMICS", "MODAL DYNAMIC", "BUCKLE", "RANDOM RESPONSE", "RESPONSE SPECTRUM"}
# What leaves the answer as it is.
SILENT = {
    "HEADING", "PREPRINT", "RESTART", "OUTPUT", "NODE OUTPUT", "ELEMENT OUTPUT", "CONTACT OUTPUT", "ENERGY OUTPUT",
    "NODE PRINT", "NODE FILE", "EL PRINT", "EL FILE", "CONTACT PRINT", "CONTACT FILE", "MODAL FILE", "MODAL OUTPUT",
    "MONITOR", "PRINT", "FILE FORMAT", "FILE OUTPUT", "CONTROLS", "CONTACT CONTROLS", "SOLVER CONTROLS",
    "TIME POINTS", "PHYSICAL CONSTANTS", "DISTRIBUTION", "DISTRIBUTION TABLE", "NODAL THICKNESS",
    "NORMAL", "CONTACT",
    "SELECT EIGENMODES", "SURFACE PROPERTY ASSIGNMENT", "CONTACT INITIALIZATION ASSIGNMENT",
    "CONTACT INITIALIZATION DATA", "INCLUDE", "SYSTEM", "SUPER ELEMENT", "DIAGNOSTICS",
    "SELECT CYCLIC SYMMETRY MODES", "VARIABLE", "ELEMENT MATRIX OUTPUT", "RADIAL",
}  # fmt: skip


def read_statement(content: Content, statement: Statement) -> None:
    """Take a statement over, or note what leaving it out means."""
    word = statement.block.keyword
    if word not in SUBOPTIONS:
        content.substance = None
    if word not in INTERACTION_SUBOPTIONS:
        content.interaction = None
    if word in HANDLERS:
        HANDLERS[word](content, statement)
        return
    what, where = f"*{word.title()}", content.where(statement)
    if word in LEFT_OUT:
        text, weight = LEFT_OUT[word]
        content.draft.find(what, where, text, weight)
    elif word in _TIMED_STEPS | _PERTURBATIONS:
        if word in _TIMED_STEPS:
            read_static(content, statement)
        else:
            content.perturbation = True
        content.draft.find(what, where, "steps of other kinds than statics and frequencies are not simulated")
    elif word not in SILENT:
        content.draft.find(what, where, "is not known here and is left out")
