"""Whether the numbers of a scene are in SI units: solids of sound waves and sizes that no brake has are asked about."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
import skfem

from ..errors import SceneError
from ..fem.materials import Material
from ..scene import Scene

# √(E/ρ): rubber and foam have some 30 to 100 m/s, steel and aluminium 5100, beryllium 12 900, diamond 18 000.
_SPEED = (100.0, 20_000.0)  # m/s
_LARGEST = 5.0  # m: brakes of railways and wind turbines are smaller
_MODULUS, _DENSITY = (1e6, 1e13), (100.0, 30_000.0)  # Pa, kg/m^3: what a change of units has to lead to
# Units that others compute in, and what turns them into Pa and kg/m^3.
_MODULI = {"Pa": 1.0, "MPa": 1e6, "GPa": 1e9, "kPa": 1e3}
_DENSITIES = {"kg/m^3": 1.0, "t/mm^3": 1e12, "kg/mm^3": 1e9, "g/cm^3": 1e3, "t/m^3": 1e3, "g/mm^3": 1e6}


def require_si(scene: Scene, mesh: skfem.Mesh, bodies: Mapping[str, np.ndarray]) -> None:
    """Check that the numbers of a scene file can be meant in SI units.

    For a scene that a script builds, whose units are the script's, the same sentences are warnings.

    Parameters
    ----------
    scene : Scene
    mesh : skfem.Mesh
    bodies : mapping of str to (m,) int
        Elements of each body.

    Raises
    ------
    SceneError
        Numbers cannot be in SI units; the message has all of them, and what to write instead.
    """
    found = suspect_units(scene, mesh, bodies) if scene.source is not None else []
    if found:
        raise SceneError(f'{"; ".join(found)}; for another consistent set of units write units = "any" at the top')


def suspect_units(scene: Scene, mesh: skfem.Mesh, bodies: Mapping[str, np.ndarray]) -> list[str]:
    """Return a sentence for each material and body that is hardly in SI units; none where the scene has any units.

    Parameters
    ----------
    mesh : Mesh
        Coordinates in m.
    bodies : mapping of body to (e,) int elements
    """
    if scene.units == "any":
        return []
    used = dict.fromkeys(scene.bodies[name].material for name in bodies)
    found = [text for name in used for text in _speed(name, scene.materials[name])]
    return found + [text for name, elements in bodies.items() for text in _size(scene, name, mesh, elements)]


def _speed(name: str, material: Material) -> Iterator[str]:
    given = material.youngs_modulus
    for E in given if isinstance(given, list) else [given]:
        speed = float(np.sqrt(E / material.density))
        if not _SPEED[0] <= speed <= _SPEED[1]:
            yield (
                f"materials.{name}: given youngs_modulus = {E:g}, density = {material.density:g}: sound at"
                f" √(E/ρ) = {speed:.3g} m/s; expected Pa and kg/m^3, with {_SPEED[0]:g} to {_SPEED[1]:g} m/s"
                f"{_meant(E, material.density)}"
            )
            return


def _meant(E: float, density: float) -> str:
    """Return what to write where some other units make sense of the numbers."""
    for modulus, to_pa in _MODULI.items():
        for unit, to_si in _DENSITIES.items():
            e, rho = E * to_pa, density * to_si
            plausible = _MODULUS[0] <= e <= _MODULUS[1] and _DENSITY[0] <= rho <= _DENSITY[1]
            if plausible and _SPEED[0] <= np.sqrt(e / rho) <= _SPEED[1]:
                return f" (if these are {modulus} and {unit}, write youngs_modulus = {e:g}, density = {rho:g})"
    return ""


def _size(scene: Scene, name: str, mesh: skfem.Mesh, elements: np.ndarray) -> Iterator[str]:
    size = float(np.ptp(mesh.p[:, np.unique(mesh.t[:, elements])], axis=1).max())
    if size > _LARGEST:
        unit = scene.mesh.length_unit
        what = 'if the mesh is in mm, write length_unit = "mm"' if unit == "m" else "is the mesh in mm?"
        yield (
            f'bodies.{name}: {size:.3g} m long with mesh.length_unit = "{unit}"; expected at most {_LARGEST:g} m'
            f" ({what})"
        )
