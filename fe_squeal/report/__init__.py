"""What the user sees of a run: figures, mode shapes for ParaView, pictures, tables and files.

Nothing is imported until it is asked for, so that a run without pictures loads neither Matplotlib nor VTK.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from fe_squeal.report.contact_face import ContactFace
    from fe_squeal.report.contributions import plot_contributions
    from fe_squeal.report.export import export_shapes, shape_name
    from fe_squeal.report.figures import plot_root_locus, plot_stability
    from fe_squeal.report.files import remove_partial, replace_atomically, write_csv, write_json
    from fe_squeal.report.pictures import draw_shape, draw_shapes
    from fe_squeal.report.preload import export_preload
    from fe_squeal.report.shapes import ShapeGrid, normalise_shape, semi_major_amplitude, shape_grid
    from fe_squeal.report.tables import print_onsets, print_unstable
    from fe_squeal.report.vtk_files import write_animation, write_shape

__all__ = [
    "ContactFace",
    "ShapeGrid",
    "draw_shape",
    "draw_shapes",
    "export_preload",
    "export_shapes",
    "normalise_shape",
    "plot_contributions",
    "plot_root_locus",
    "plot_stability",
    "print_onsets",
    "print_unstable",
    "remove_partial",
    "replace_atomically",
    "semi_major_amplitude",
    "shape_grid",
    "shape_name",
    "write_animation",
    "write_csv",
    "write_json",
    "write_shape",
]

_MODULES = {
    "contributions": ("plot_contributions",),
    "export": ("export_shapes", "shape_name"),
    "figures": ("plot_root_locus", "plot_stability"),
    "files": ("remove_partial", "replace_atomically", "write_csv", "write_json"),
    "pictures": ("draw_shape", "draw_shapes"),
    "contact_face": ("ContactFace",),
    "preload": ("export_preload",),
    "shapes": ("ShapeGrid", "normalise_shape", "semi_major_amplitude", "shape_grid"),
    "tables": ("print_onsets", "print_unstable"),
    "vtk_files": ("write_animation", "write_shape"),
}


def __getattr__(name: str) -> Any:
    for module, names in _MODULES.items():
        if name in names:
            return getattr(importlib.import_module(f"{__name__}.{module}"), name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
