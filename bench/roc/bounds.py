"""What no detector can do better: the likelihood ratio over all waveforms that may come, from below and from above.

Who knows every waveform with its probability, but not which comes, decides best by the mean of their likelihood ratios
(Neyman and Pearson).  There are more waveforms than can be simulated, so two things are measured with N of them:

    fresh  impacts of other motions than the N: a detector that could be built, so the best one needs no more;
    same   impacts that are among the N: the best for that smaller world, an easier one, so the best one needs no less.

They meet as N grows; their distance is the error that is left.
"""

from __future__ import annotations

import numpy as np

from lostmotion.detector.window import FloatArray

__all__ = ["likelihoods"]

CHUNK = 500


def likelihoods(noise: FloatArray, signals: FloatArray | None, library: FloatArray, sizes: FloatArray) -> FloatArray:
    """ln of the mean over the library of exp(s y·h - s²/2), shape (sizes, M), for windows y = noise + s signal.

    noise: whitened, (M, N); signals: of unit energy after whitening, (M, N), None for windows without impact; library:
    likewise, (L, N); sizes: s, root of the impact's energy.
    """
    shapes = np.asarray(library.T, np.float32)
    out = np.empty((len(sizes), len(noise)))
    for first in range(0, len(noise), CHUNK):
        part = slice(first, first + CHUNK)
        beside = np.asarray(noise[part], np.float32) @ shapes
        within = None if signals is None else np.asarray(signals[part], np.float32) @ shapes
        for row, size in enumerate(sizes.astype(np.float32)):
            logs = size * beside if within is None else size * (beside + size * within)
            top = logs.max(axis=1)
            out[row, part] = top - size**2 / 2 + np.log(np.exp(logs - top[:, None]).mean(axis=1))
    return out
