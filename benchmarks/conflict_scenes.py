"""Scenes of aircraft in conflict, and the method MVP: what `resolve` is compared with.

`generated` draws the 16 kinds of Pelegrín and Cerulli, Aircraft conflict resolution: a benchmark generator (INFORMS
Journal on Computing 2023; preprint HAL hal-02902566), written from their description with their default values: 10
aircraft, 400 kn, 5 nmi. Aircraft fly straight for an hour. In three dimensions the separation is a cylinder here, 5 nmi
wide and high, and a ball there.

`published` has scenes of the simulator BlueSky: aircraft that meet in one point, in a wall, in a matrix.

`voltage` flies aircraft by the Modified Voltage Potential (Hoekstra, van Gent and Ruigrok 2002, as in BlueSky): each
second each aircraft adds, for each conflict of the next five minutes, the change of velocity that brings the closest
approach to the edge of the other's zone. Past it, it flies to its destination.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from conflictdb import Scene, Track

Floats = NDArray[np.float64]

NMI_M: Final = 1852.0
APART_NMI: Final = 5.0
KINDS: Final = ("CP", "RCP", "RP", "RRP", "GP", "RGP", "PR2", "R2", "SP", "RSP", "PL", "RPL", "QP", "RQP", "PR3", "R3")
_T0_US: Final = 1_780_000_000_000_000
_SPEED_KN: Final = 400.0
_DEVIATION: Final = np.pi / 6.0  # of headings in the random kinds


@dataclass(frozen=True, slots=True)
class Flights:
    """Aircraft that fly straight: start (n, 3) in nmi, velocity (n, 3) in knots, for some hours."""

    start: Floats
    velocity: Floats
    hours: float = 1.0

    @property
    def end(self) -> Floats:
        """Where they arrive (n, 3)."""
        return self.start + self.hours * self.velocity

    def objects(self) -> tuple[Scene, list[Track]]:
        """Return them as tracks around 0 N 0 E."""
        is_level = not self.velocity[:, 2].any() and not self.start[:, 2].any()
        tracks = []
        for k, (a, b) in enumerate(zip(self.start, self.end, strict=True)):
            heights = None if is_level else [NMI_M * a[2], NMI_M * b[2]]
            tracks.append(
                Track(
                    f"AC{k:03d}",
                    [(a[0] / 60.0, a[1] / 60.0), (b[0] / 60.0, b[1] / 60.0)],
                    [_T0_US, _T0_US + round(3.6e9 * self.hours)],
                    [(0.0, 0.0)],
                    floors_m=heights,
                    ceilings_m=None if heights is None else [one + 1.0 for one in heights],
                )
            )
        high = {} if is_level else {"vertical_separation_m": APART_NMI * NMI_M}
        return Scene("flights", separation_m=APART_NMI * NMI_M, **high), tracks

    def losses(self) -> set[tuple[int, int]]:
        """Return the pairs that come nearer than the separation while both fly, in the plane or in space."""
        found = set()
        for i in range(len(self.start)):
            apart, relative = self.start - self.start[i], self.velocity - self.velocity[i]
            square = np.maximum((relative**2).sum(axis=1), 1e-12)
            at = np.clip(-(apart * relative).sum(axis=1) / square, 0.0, self.hours)
            nearest = np.linalg.norm(apart + at[:, None] * relative, axis=1)
            found |= {(i, int(j)) for j in np.flatnonzero(nearest < APART_NMI) if j > i}
        return found


def generated(kind: str, seed: int = 14) -> Flights:
    """Return a scene of one of KINDS."""
    rng = np.random.default_rng(seed)
    if kind in ("CP", "RCP", "SP", "RSP"):
        start = 200.0 * (_circle(10) if kind.endswith("CP") else _sphere(10))
        toward = -start / 200.0
    elif kind in ("RP", "RRP", "GP", "RGP"):
        start, toward = _trails(2, 2, np.pi / (2.0 if "G" in kind else 4.0))
    elif kind in ("PL", "RPL", "QP", "RQP"):
        start, toward = _planes(is_cubic="Q" in kind)
    else:
        return _random(rng, size_nmi=400.0 if kind.endswith("2") else 100.0, kind=kind)
    if kind.startswith("R") and kind != "RP":
        toward = _turned(toward, rng.uniform(-_DEVIATION, _DEVIATION, len(toward)))
    return Flights(start, _SPEED_KN * toward)


def published(kind: str, count: int) -> Flights:
    """Return the scene SUPER, WALL or MATRIX of BlueSky."""
    kn = 200.0 / 0.514444
    if kind == "SUPER":
        start = 60.0 * 0.5 * _circle(count)
        return Flights(start, -kn * start / 30.0, 0.3)
    if kind == "WALL":
        wall = np.array([(36.0, (k - count // 2) * 1.1 * APART_NMI, 0.0) for k in range(count)])
        start = np.concatenate([[(-36.0, 0.0, 0.0)], wall])
        east = np.ones(count + 1)
        east[1:] = -1.0
        return Flights(start, kn * np.stack([east, np.zeros(count + 1), np.zeros(count + 1)], axis=1), 0.3)
    side = (np.arange(count) - (count - 1) / 2.0) * 1.1 * APART_NMI
    far = np.full(count, 1.1 * APART_NMI * (count - 1) / 2.0 + 1.1 * kn / 12.0)
    zero = np.zeros(count)
    start = [(side, far), (side, -far), (far, side), (-far, side)]
    toward = [(0.0, -1.0), (0.0, 1.0), (-1.0, 0.0), (1.0, 0.0)]
    return Flights(
        np.concatenate([np.stack([x, y, zero], axis=1) for x, y in start]),
        kn * np.repeat([(x, y, 0.0) for x, y in toward], count, axis=0),
        0.5,
    )


def voltage(flights: Flights, look_s: float = 300.0, slowest: float = 0.8, fastest: float = 1.1) -> dict[str, float]:
    """Fly level aircraft by MVP; return pairs that lose separation, those of them that are new, and extra minutes."""
    n, apart_nmi = len(flights.start), APART_NMI
    at, goal = flights.start[:, :2].copy(), flights.end[:, :2]
    planned_kn = np.linalg.norm(flights.velocity[:, :2], axis=1)
    velocity = flights.velocity[:, :2].copy()
    resolving: set[tuple[int, int]] = set()
    lost: set[tuple[int, int]] = set()
    arrived_s = np.full(n, np.inf)
    step_s = 1.0
    for second in range(int(3600 * flights.hours * 3)):
        flies = ~np.isfinite(arrived_s)
        home = goal - at
        left_nmi = np.linalg.norm(home, axis=1)
        here = flies & (left_nmi < np.maximum(planned_kn, 1.0) * step_s / 3600.0)
        arrived_s[here] = second
        flies &= ~here
        if not flies.any():
            break
        apart = at[None] - at[:, None]
        relative = (velocity[None] - velocity[:, None]) / 3600.0
        both = flies[:, None] & flies[None] & ~np.eye(n, dtype=np.bool_)
        distance = np.linalg.norm(apart, axis=2)
        lost |= {(i, j) for i, j in np.argwhere(both & (distance < apart_nmi)).tolist() if i < j}
        square = np.maximum((relative**2).sum(axis=2), 1e-12)
        nearest_s = -(apart * relative).sum(axis=2) / square
        closest = apart + nearest_s[:, :, None] * relative
        nearest = np.linalg.norm(closest, axis=2)
        enters_s = nearest_s - np.sqrt(np.maximum(apart_nmi**2 - nearest**2, 0.0) / square)
        conflict = both & (nearest < apart_nmi) & (nearest_s > 0.0) & (enters_s < look_s)
        change = np.zeros_like(at)
        for i, j in np.argwhere(conflict).tolist():
            miss, push = closest[i, j], max(nearest[i, j], 10.0 / NMI_M)
            if nearest[i, j] <= 10.0 / NMI_M:
                miss = np.array([apart[i, j, 1], -apart[i, j, 0]]) / distance[i, j] * push
            wider = 1.0
            if push < apart_nmi < distance[i, j]:
                wider = np.cos(np.arcsin(apart_nmi / distance[i, j]) - np.arcsin(push / distance[i, j]))
            change[i] -= 3600.0 * (apart_nmi / wider - push) * miss / (nearest_s[i, j] * push)
            resolving.add((i, j))
        # A conflict is over past the closest approach, outside the zone.
        resolving = {
            (i, j) for i, j in resolving if both[i, j] and (nearest_s[i, j] > 0.0 or distance[i, j] < apart_nmi)
        }
        busy = np.zeros(n, np.bool_)
        busy[[i for i, _ in resolving]] = True
        direct = planned_kn[:, None] * home / np.maximum(left_nmi, 1e-9)[:, None]
        velocity = np.where(busy[:, None], velocity + change, direct)
        speed = np.linalg.norm(velocity, axis=1)
        velocity *= (np.clip(speed, slowest * planned_kn, fastest * planned_kn) / np.maximum(speed, 1e-9))[:, None]
        at[flies] += velocity[flies] * step_s / 3600.0
    more_min = np.minimum(arrived_s, 3600.0 * flights.hours * 3) / 60.0 - 60.0 * flights.hours
    before = flights.losses()
    return {
        "before": len(before),
        "lost": len(lost),
        "new": len(lost - before),
        "total_min": float(np.maximum(more_min, 0.0).sum()),
        "largest_min": float(max(more_min.max(), 0.0)),
    }


def _circle(count: int) -> Floats:
    angle = 2.0 * np.pi * np.arange(count) / count
    return np.stack([np.cos(angle), np.sin(angle), np.zeros(count)], axis=1)


def _sphere(count: int) -> Floats:
    """Return points spread evenly over a sphere, on a spiral."""
    z = 1.0 - 2.0 * (np.arange(count) + 0.5) / count
    angle = np.pi * (3.0 - np.sqrt(5.0)) * np.arange(count)
    flat = np.sqrt(1.0 - z**2)
    return np.stack([flat * np.cos(angle), flat * np.sin(angle), z], axis=1)


def _trails(level: int, sloping: int, slope: float, far_nmi: float = 100.0) -> tuple[Floats, Floats]:
    """Return level trails and trails at a slope, three separations apart, an aircraft on each."""
    space = 3.0 * APART_NMI
    along = np.array([np.cos(slope), np.sin(slope)])
    across = np.array([-along[1], along[0]])
    start = [(-far_nmi, space * (k - (level - 1) / 2.0), 0.0) for k in range(level)]
    start += [(*(-far_nmi * along + space * (k - (sloping - 1) / 2.0) * across), 0.0) for k in range(sloping)]
    toward = [(1.0, 0.0, 0.0)] * level + [(*along, 0.0)] * sloping
    return np.array(start), np.array(toward)


def _planes(is_cubic: bool) -> tuple[Floats, Floats]:
    """Return three level planes with two trails each way, and two upright planes with two sloping trails each."""
    space = 3.0 * APART_NMI
    parts = []
    for k in range(3):
        start, toward = _trails(2, 2, np.pi / (2.0 if is_cubic else 6.0))
        start[:, 2] = space * (k - 1)
        parts.append((start, toward))
    slope = np.pi / 2.0 if is_cubic else 2.0 * np.pi / 3.0
    for k in range(2):
        start, toward = _trails(0, 2, slope)
        upright = [start[:, [0, 2, 1]] + [0.0, space * (k - 0.5), 0.0], toward[:, [0, 2, 1]]]
        parts.append((upright[0], upright[1]))
    return np.concatenate([one for one, _ in parts]), np.concatenate([one for _, one in parts])


def _turned(toward: Floats, by: Floats) -> Floats:
    """Return directions turned about the vertical."""
    x, y = toward[:, 0], toward[:, 1]
    return np.stack([x * np.cos(by) - y * np.sin(by), x * np.sin(by) + y * np.cos(by), toward[:, 2]], axis=1)


def _random(rng: np.random.Generator, size_nmi: float, kind: str, count: int = 10) -> Flights:
    """Return random aircraft in a square or cube; of the pseudo-random kinds, from its borders, with 12 conflicts."""
    is_flat, is_wanted = kind.endswith("2"), kind.startswith("P")
    wanted = round(0.5 * (count / 2.0) * ((1.0 + count - 1.0) / 2.0))
    hours = size_nmi * np.sqrt(2.0) / _SPEED_KN
    flights = Flights(np.empty((0, 3)), np.empty((0, 3)), hours)
    for k in range(count):
        tried = []
        for _ in range(200 if is_wanted else 1):
            place, toward = rng.uniform(-0.5, 0.5, 3) * size_nmi, rng.normal(size=3)
            if is_wanted:
                axis = int(rng.integers(2 if is_flat else 3))
                place[axis] = 0.5 * size_nmi * rng.choice([-1.0, 1.0])
                toward[axis] = -abs(toward[axis]) * np.sign(place[axis])
            if is_flat:
                place[2] = toward[2] = 0.0
            toward *= _SPEED_KN / np.linalg.norm(toward)
            start, velocity = np.vstack([flights.start, place]), np.vstack([flights.velocity, toward])
            tried.append(Flights(start, velocity, hours))
        # Conflicts grow with the pairs.
        goal = wanted * k * (k + 1) / (count * (count - 1.0))
        flights = min(tried, key=lambda one: abs(len(one.losses()) - goal))
    return flights
