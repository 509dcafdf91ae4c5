"""Parametric geometries (a disc with pads, blocks on a belt), and meshes of them with named groups."""

from fe_squeal.geometry.block import Block
from fe_squeal.geometry.disc_pad import DiscPad
from fe_squeal.geometry.writing import make_mesh, write_mesh

__all__ = ["Block", "DiscPad", "make_mesh", "write_mesh"]
