"""Sums of element matrices over pairs of nodes, against the plain sum over elements."""

import numpy as np
import pytest
import skfem

from fe_squeal.fem.element_matrices import assemble_elasticity
from fe_squeal.fem.node_sums import NodeSums, scatter
from fe_squeal.fem.spaces import DisplacementSpace

FUNCTIONS = 12


def elements(count: int = 40, local: int = 4, seed: int = 1) -> np.ndarray:
    rng = np.random.default_rng(seed)
    # The function 5 is of no element.
    return np.array([rng.choice(np.delete(np.arange(FUNCTIONS), 5), local, replace=False) for _ in range(count)])


def plain(blocks: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    total = np.zeros((FUNCTIONS, FUNCTIONS, *blocks.shape[3:]))
    for block, own in zip(blocks, nodes, strict=True):
        total[np.ix_(own, own)] += block
    return total


@pytest.mark.parametrize("kept", [None, [0, 2, 5, 7, 11], [4]])
def test_sums_are_those_of_the_elements(kept):
    nodes, rng = elements(), np.random.default_rng(2)
    one, three = (rng.standard_normal((len(nodes), 4, 4, *more)) for more in ((), (3, 3)))
    own = np.arange(FUNCTIONS) if kept is None else np.array(kept)
    sums = NodeSums(nodes, FUNCTIONS, None if kept is None else own)
    scalar, vector = sums.scalar(one), sums.vector(three)
    assert scalar.toarray() == pytest.approx(plain(one, nodes)[np.ix_(own, own)], abs=1e-13)
    wanted = plain(three, nodes)[np.ix_(own, own)].transpose(0, 2, 1, 3).reshape(3 * len(own), -1)
    assert vector.toarray() == pytest.approx(wanted, abs=1e-13)
    assert scalar.has_canonical_format and vector.has_canonical_format
    assert (scatter(one, nodes, FUNCTIONS) != NodeSums(nodes, FUNCTIONS).scalar(one)).nnz == 0


def test_sums_of_symmetric_blocks_are_symmetric_to_the_last_bit():
    nodes, rng = elements(4000), np.random.default_rng(3)
    blocks = rng.standard_normal((len(nodes), 4, 4, 3, 3)) * 10.0 ** rng.uniform(-8, 8, (len(nodes), 1, 1, 1, 1))
    sums = NodeSums(nodes, FUNCTIONS)
    total = sums.vector(blocks + blocks.transpose(0, 2, 1, 4, 3))
    assert abs(total - total.T).max() == 0
    # In another order of the elements the last bits are others, so that the test above could fail.
    other = NodeSums(nodes[::-1], FUNCTIONS).vector((blocks + blocks.transpose(0, 2, 1, 4, 3))[::-1])
    assert 0 < abs(total - other).max() < 1e-12 * abs(total).max()


@pytest.mark.parametrize("order", [1, 2])
def test_matrices_of_a_partly_held_block_are_those_of_the_free_one_there(order):
    mesh = skfem.MeshHex.init_tensor(*(np.linspace(0, 1, n) for n in (4, 3, 3)))
    free = DisplacementSpace(mesh, order, np.zeros(3 * DisplacementSpace(mesh, order, np.zeros(0, bool)).nodes, bool))
    rng = np.random.default_rng(4)
    held = rng.random((free.nodes, 3)) < 0.3
    held[rng.random(free.nodes) < 0.2] = True  # some nodes in all directions
    # Anisotropic, with the symmetry that an elastic energy has alone.
    C = rng.standard_normal((3, 3, 3, 3))
    C = C + C.transpose(1, 0, 2, 3)
    C = C + C.transpose(0, 1, 3, 2)
    C = C + C.transpose(2, 3, 0, 1)
    cells, own = np.arange(mesh.nelements), np.flatnonzero(~held.ravel())
    partly = assemble_elasticity(DisplacementSpace(mesh, order, held.ravel()), cells, C, 3.0)
    for A, whole in zip(partly, assemble_elasticity(free, cells, C, 3.0), strict=True):
        assert abs(A - whole[own][:, own]).max() <= 1e-14 * abs(whole).max()
        assert abs(A - A.T).max() == 0


def test_stiffness_of_an_anisotropic_material_does_the_work_of_its_stresses():
    mesh = skfem.MeshHex.init_tensor(*(np.linspace(0, 1, 3),) * 3)
    space = DisplacementSpace(mesh, 1, np.zeros(81, bool))
    rng = np.random.default_rng(5)
    C = rng.standard_normal((3, 3, 3, 3))
    C = C + C.transpose(1, 0, 2, 3)
    C = C + C.transpose(0, 1, 3, 2)
    C = C + C.transpose(2, 3, 0, 1)
    K, _ = assemble_elasticity(space, np.arange(mesh.nelements), C, 1.0)
    F, G = rng.standard_normal((2, 3, 3))  # two uniform gradients on the unit cube
    u, v = (np.asarray(H @ mesh.p).T.ravel() for H in (F, G))
    assert u @ (K @ v) == pytest.approx(np.einsum("ab,abcd,cd", F, C, G), rel=1e-12)
