"""Further kinds of random sweeps, like structures: chains, contacts, rotors, rings; `families` has the judge."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.linalg as la
import scipy.sparse as sp
from families import Family

Part = tuple[str, np.ndarray, int, bool]


def part(slot: str, A: np.ndarray, power: int = 0, imaginary: bool = False) -> Part:
    return slot, A, power, imaginary


def sparse(rng: np.random.Generator, n: int, density: float) -> np.ndarray:
    return sp.random(n, n, density, random_state=np.random.RandomState(rng.integers(2**31))).toarray()


def definite(rng: np.random.Generator, n: int, density: float = 0.4, least: float = 1.0) -> np.ndarray:
    A = sparse(rng, n, density)
    return A @ A.T + least * np.eye(n)


def even(rng: np.random.Generator, low: float = 0.0, high: float = 1.0) -> np.ndarray:
    return np.linspace(low, high, int(rng.integers(6, 31)))


def springs(k: np.ndarray) -> np.ndarray:
    """Return the stiffness (n, n) of a chain between two walls, from its n + 1 springs."""
    inner = np.diag(k[1:-1], 1)
    return np.diag(k[:-1] + k[1:]) - inner - inner.T


def contacts(rng: np.random.Generator, n: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the matrices of springs between pairs of unknowns, and of friction: their force acts on two others too."""
    N, F = np.zeros((n, n)), np.zeros((n, n))
    for _ in range(int(rng.integers(1, max(2, n // 2)))):
        i, j, t, u = rng.permutation(n)[:4]
        g, s = np.zeros(n), np.zeros(n)
        g[i], g[j] = 1, -rng.uniform(0, 1)
        s[t], s[u] = 1, -rng.uniform(0, 1)
        k = 10 ** rng.uniform(-0.5, 1.5)
        N += k * np.outer(g, g)
        F += k * np.outer(s, g)
    return N, F


def chain(rng: np.random.Generator) -> Family:
    """Return a chain with contacts; friction is swept."""
    n = int(rng.integers(5, 14))
    K, M = springs(10 ** rng.uniform(-0.5, 1.5, n + 1)), np.diag(10 ** rng.uniform(-0.5, 0.5, n))
    N, F = contacts(rng, n)
    values = even(rng, 0, float(rng.uniform(0.5, 2)))
    return Family("chain", (part("M", M), part("K", K + N), part("K", F, 1)), values)


def chain_damped(rng: np.random.Generator) -> Family:
    """Return a chain with contacts and dampers between the masses; friction is swept."""
    base = chain(rng)
    n = len(base.parts[0][1])
    c = 10 ** rng.uniform(-6, -1)
    return Family("chain damped", (*base.parts, part("C", springs(c * 10 ** rng.uniform(-1, 1, n + 1)))), base.values)


def chain_stiff(rng: np.random.Generator) -> Family:
    """Return a chain with contacts whose stiffness is swept, over decades or not; dampers, loss factors or neither."""
    n = int(rng.integers(5, 12))
    K, M = springs(10 ** rng.uniform(-0.5, 1.5, n + 1)), np.diag(10 ** rng.uniform(-0.5, 0.5, n))
    N, F = contacts(rng, n)
    parts = [part("M", M), part("K", K), part("K", N + rng.uniform(0.3, 1) * F, 1)]
    kind = rng.integers(3)
    if kind == 1:
        parts.append(part("C", springs(10 ** rng.uniform(-4, -1) * 10 ** rng.uniform(-1, 1, n + 1))))
    if kind == 2:
        parts.append(part("K", K * 10 ** rng.uniform(-4, -1.5), 0, True))
    d = rng.uniform(1, 4)
    if rng.integers(2):
        values = np.geomspace(10**-d, 10**d, int(rng.integers(7, 25)))
    else:
        values = np.linspace(0.01, rng.uniform(1, 30), int(rng.integers(7, 25)))
    return Family("chain, stiffness", tuple(parts), values)


def sparse_mass(rng: np.random.Generator) -> Family:
    """Return random sparse matrices, M too."""
    n = int(rng.integers(6, 14))
    M, K = definite(rng, n, 0.3), definite(rng, n, 0.4) * 10
    F = sparse(rng, n, 0.3) * rng.uniform(2, 20)
    return Family("sparse", (part("M", M), part("K", K), part("K", F, 1)), even(rng))


def clustered(rng: np.random.Generator) -> Family:
    """Return some clusters of two to five frequencies."""
    n, width = int(rng.integers(6, 13)), 10 ** rng.uniform(-6, -1)
    centres = rng.uniform(2, 30, 4)
    theta = np.concatenate([c * (1 + width * rng.standard_normal(int(rng.integers(2, 6)))) for c in centres])[:n]
    n = len(theta)
    parts = [part("M", np.eye(n)), part("K", np.diag(theta))]
    parts.append(part("K", rng.standard_normal((n, n)) * 10 ** rng.uniform(-2, 1), 1))
    if rng.integers(2):
        parts.append(part("C", np.diag(rng.uniform(0.2, 1, n)) * 10 ** rng.uniform(-4, -1)))
    return Family("clustered", tuple(parts), even(rng))


def four(rng: np.random.Generator) -> Family:
    """Return four branches that cross at one value, with weak coupling."""
    n, values = int(rng.integers(6, 11)), even(rng)
    at, size = rng.uniform(0.2, 0.9), 10 ** rng.uniform(-4, -1)
    slopes = rng.uniform(-3, 3, 4)
    theta = np.concatenate([10 - slopes * at, rng.uniform(15, 30, n - 4)])
    F, E = np.zeros((n, n)), rng.standard_normal((4, 4)) * size
    F[:4, :4] = np.diag(slopes) + E - np.diag(np.diag(E))
    F[:4, 4:], F[4:, :] = rng.standard_normal((4, n - 4)) * 0.1, rng.standard_normal((n - 4, n)) * 0.3
    Q = la.qr(rng.standard_normal((n, n)))[0]
    parts = [part("M", np.eye(n)), part("K", Q.T @ np.diag(theta) @ Q), part("K", Q.T @ F @ Q, 1)]
    if rng.integers(3) == 0:
        parts.append(part("C", np.eye(n) * 10 ** rng.uniform(-5, -2)))
    return Family("four", tuple(parts), values, planted=(float(at),))


def nonnormal(rng: np.random.Generator) -> Family:
    """Return a nonnormal problem: coupling is strong in one direction and weak in the other."""
    n = int(rng.integers(4, 10))
    theta, large = np.sort(rng.uniform(1, 30, n)), 10 ** rng.uniform(0.5, 2.5)
    F = np.triu(rng.standard_normal((n, n)), 1) * large
    F += np.tril(rng.standard_normal((n, n))) * 10 ** rng.uniform(-2, 0.5)
    parts = [part("M", np.eye(n)), part("K", np.diag(theta)), part("K", F, 1)]
    if rng.integers(2):
        parts.append(part("C", np.diag(rng.uniform(0.01, 0.1, n))))
    return Family("nonnormal", tuple(parts), even(rng, 0, rng.uniform(0.3, 1)))


def negative_power(rng: np.random.Generator) -> Family:
    """Return negative damping that falls with the swept speed, and is so strong that modes do not oscillate."""
    n = int(rng.integers(5, 12))
    K, M = definite(rng, n, 0.4) * 10, np.diag(rng.uniform(0.5, 2, n))
    N, F = contacts(rng, n)
    K = K + N + rng.uniform(0.1, 0.8) * F
    g, C = rng.standard_normal(n), np.diag(rng.uniform(0.005, 0.05, n))
    falling = -np.outer(g, g) * rng.uniform(0.01, 0.3)
    parts = [part("M", M), part("K", K), part("C", C), part("C", falling, -1 if rng.integers(2) else -2)]
    if rng.integers(2):
        parts.append(part("C", (F + F.T) * rng.uniform(0, 0.02) + N * 0.01, -1))
    if rng.integers(2):
        return Family("1/p", tuple(parts), np.geomspace(0.1, rng.uniform(3, 100), int(rng.integers(6, 20))))
    return Family("1/p", tuple(parts), np.linspace(0.2, rng.uniform(2, 20), int(rng.integers(6, 20))))


def rotor(rng: np.random.Generator) -> Family:
    """Return a sweep of a speed: gyroscopic forces, stiffening by its square; dampers are fixed, rotating or absent."""
    n = 2 * int(rng.integers(2, 6))
    K = np.diag(np.repeat(rng.uniform(1, 30, n // 2), 2)) if rng.integers(2) else definite(rng, n) * 5
    G = rng.standard_normal((n, n))
    G = (G - G.T) * rng.uniform(0.1, 1)
    stress = definite(rng, n, 0.3, 0) * rng.uniform(-0.5, 0.5)
    D = definite(rng, n, 0.3) * 10 ** rng.uniform(-4, -1.5)
    S = rng.standard_normal((n, n))
    parts = [part("M", np.eye(n)), part("K", K), part("C", G, 1), part("K", stress, 2)]
    kind = rng.integers(3)
    if kind >= 1:
        parts.append(part("C", D))
    if kind == 2:
        parts.append(part("K", (S - S.T) * la.norm(D) * rng.uniform(0.1, 3), 1))
    return Family("rotor", tuple(parts), even(rng, 0, rng.uniform(0.5, 4)))


def loss(rng: np.random.Generator) -> Family:
    """Return a problem with loss factors; friction or the stiffness of contacts is swept, with dampers or without."""
    n = int(rng.integers(5, 12))
    K = definite(rng, n) * 5
    N, F = contacts(rng, n)
    parts = [part("M", np.diag(rng.uniform(0.5, 2, n))), part("K", K)]
    parts.append(part("K", K * 10 ** rng.uniform(-5, -1), 0, True))
    if rng.integers(2):
        parts += [part("K", N + rng.uniform(0.2, 1) * F, 1), part("K", N * 10 ** rng.uniform(-4, -1), 1, True)]
        values = np.geomspace(0.01, 100, int(rng.integers(8, 25)))
    else:
        parts += [part("K", N), part("K", F, 1)]
        values = even(rng, 0, 1.5)
    if rng.integers(2):
        parts.append(part("C", np.eye(n) * 10 ** rng.uniform(-4, -2)))
    return Family("loss", tuple(parts), values)


def weak(rng: np.random.Generator) -> Family:
    """Return a problem with very light damping, 1e-7 to 1e-5."""
    base = (chain, sparse_mass, four)[int(rng.integers(3))](rng)
    parts = tuple(p for p in base.parts if p[0] != "C")
    C = definite(rng, len(parts[0][1])) * 10 ** rng.uniform(-7, -5)
    return Family(f"weakly damped {base.name}", (*parts, part("C", C)), base.values, base.planted, growth=0.0)


def cyclic(rng: np.random.Generator) -> Family:
    """Return a ring of equal sectors, whose frequencies are mostly double, with or without a spring on one sector."""
    sectors, b = int(rng.integers(3, 6)), int(rng.integers(1, 3))
    n, turn = sectors * b, np.roll(np.eye(sectors), 1, axis=1)
    own, next_ = definite(rng, b) * 8, -rng.standard_normal((b, b))
    K = np.kron(np.eye(sectors), own) + np.kron(turn, next_) + np.kron(turn.T, next_.T)
    K += max(0.0, 1 - la.eigvalsh(K)[0]) * np.eye(n)
    B, kind = rng.standard_normal((b, b)), rng.integers(3)
    F = np.kron(turn if kind == 1 else np.eye(sectors), B)
    if kind == 2:
        F = F + np.kron(turn, rng.standard_normal((b, b)))
    if rng.integers(2):
        i = rng.integers(n)
        K[i, i] += 10 ** rng.uniform(-6, 0)
    parts = [part("M", np.eye(n)), part("K", K), part("K", F * rng.uniform(1, 5), 1)]
    values = even(rng)
    if rng.integers(3) == 0:
        parts.append(part("C", np.eye(n) * 10 ** rng.uniform(-4, -1)))
    return Family("cyclic", tuple(parts), values)


def mass(rng: np.random.Generator) -> Family:
    """Return a chain with contacts and a mass that is swept."""
    base = chain(rng)
    M, K, F = (A for _, A, _, _ in base.parts)
    n, mu = len(M), rng.uniform(0.3, 1.5)
    g = np.zeros(n)
    g[rng.integers(n)] = 1
    parts = [part("M", M), part("M", np.outer(g, g), 1), part("K", K + mu * F)]
    if rng.integers(2):
        parts.append(part("C", springs(10 ** rng.uniform(-3, -1) * np.ones(n + 1))))
    values = even(rng, 0, 5) if rng.integers(2) else np.geomspace(0.01, 100, int(rng.integers(8, 20)))
    return Family("mass", tuple(parts), values)


def follower(rng: np.random.Generator) -> Family:
    """Return loads that reduce stiffness, and follower loads: divergence and flutter, strongly damped or not."""
    n = int(rng.integers(4, 10))
    K, N = springs(10 ** rng.uniform(0, 1.5, n + 1)), np.diag(rng.uniform(0, 1, n))
    S = rng.standard_normal((n, n)) * rng.uniform(0.1, 2)
    parts = [part("M", np.diag(rng.uniform(0.5, 2, n))), part("K", K), part("K", -(N * rng.uniform(1, 8) + S), 1)]
    if rng.integers(2):
        parts.append(part("C", springs(10 ** rng.uniform(-2, 1) * 10 ** rng.uniform(-1, 0, n + 1))))
    return Family("follower", tuple(parts), even(rng, 0, rng.uniform(1, 4)))


KINDS = (
    chain, chain_damped, chain_stiff, sparse_mass, clustered, four, nonnormal, negative_power, rotor, loss, weak,
    cyclic, mass, follower,
)  # fmt: skip


def make(kind: Callable[[np.random.Generator], Family], seed: int) -> Family:
    """Return the family of a kind for a seed, always the same one."""
    return kind(np.random.default_rng([seed, 77, KINDS.index(kind)]))
