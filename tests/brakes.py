"""The parametric brake and blocks that tests of geometries begin with."""

from typing import Any, Literal

Kind = Literal["hex", "tet"]
BRAKE: dict[str, Any] = dict(
    inner_radius=0.07,
    outer_radius=0.13,
    thickness=0.012,
    pad_inner_radius=0.085,
    pad_outer_radius=0.128,
    pad_angle_deg=50,
    pad_thickness=0.011,
    back_plate_thickness=0.005,
    size=0.014,
)
BLOCK: dict[str, Any] = dict(length=0.08, width=0.04, height=0.015, size=0.01)
ROW: dict[str, Any] = {**BLOCK, "count": 3, "spacing": 0.02, "belt_thickness": 0.012, "belt_margin_x": 0.03}
