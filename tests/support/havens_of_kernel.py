"""Where the kernel has a haven at an instant, in degrees: what SQL and the page are held against."""

import numpy as np

from conflictdb import kernel
from conflictdb.arrays.objects import TrackBatch
from conflictdb.core.pieces.cutting import track_pieces
from conflictdb.earth.registry import Setup
from conflictdb.kernel.movement import Movement
from conflictdb.model.plans import Scene, Track


def haven_deg(scene: Scene, track: Track, us: int) -> np.ndarray:
    """Return the vertices (n, 2) at an instant within a leg: longitude (not wrapped) and latitude."""
    setup = Setup.of(scene)
    pieces = track_pieces(setup, TrackBatch.of([track]))
    row = np.flatnonzero((pieces.start_us <= us) & (us < pieces.end_us) & (pieces.turn == 0))[:1]
    haven = Movement.of(kernel.KernelScene(setup.plane.kernel_plane, pieces), row, np.array([us]))
    x, y = haven.positions(np.zeros(1))[:, : haven.slots, 0]
    return np.stack(setup.plane.from_plane(x, y), axis=1)
