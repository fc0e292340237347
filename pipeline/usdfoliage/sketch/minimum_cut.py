"""Labels of pixels that minimise a Gibbs energy of two labels, by a minimum cut (SciPy's maximum flow)."""

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csr_array
from scipy.sparse.csgraph import breadth_first_order, maximum_flow

_STEPS = 100  # of capacities for each unit of energy: they are whole numbers
_MAX_CAPACITY = 1_000_000


def cut_pixels(
    energy: NDArray[np.float64], right: NDArray[np.float64], down: NDArray[np.float64], domain: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """(H, W) the pixels of a domain that are of the object, where the sum of energies is least.

    Args:
        energy: (H, W), energy of a pixel of the object less that of one of the background.
        right: (H, W - 1), energy where a pixel and that to its right have other labels.
        down: (H - 1, W), likewise with that below.
        domain: (H, W), where there are labels; all else is background and of no weight.
    """
    number = np.full(domain.shape, -1, np.int64)
    count = int(domain.sum())
    if not count:
        return np.zeros(domain.shape, bool)
    number[domain] = np.arange(count)
    pairs = [
        (number[:, :-1], number[:, 1:], right),
        (number[:-1], number[1:], down),
    ]
    one = np.concatenate([a[(a >= 0) & (b >= 0)] for a, b, _ in pairs])
    other = np.concatenate([b[(a >= 0) & (b >= 0)] for a, b, _ in pairs])
    weight = np.concatenate([c[(a >= 0) & (b >= 0)] for a, b, c in pairs])
    own = energy[domain]
    source, sink, pixel = count, count + 1, np.arange(count)
    capacity = np.concatenate([weight, weight, np.maximum(-own, 0), np.maximum(own, 0)])
    graph = csr_array(
        coo_array(
            (
                np.minimum(np.rint(capacity * _STEPS), _MAX_CAPACITY).astype(np.int32),
                (
                    np.concatenate([one, other, np.full(count, source), pixel]),
                    np.concatenate([other, one, pixel, np.full(count, sink)]),
                ),
            ),
            shape=(count + 2, count + 2),
        )
    )
    flow = maximum_flow(graph, source, sink).flow
    left = graph - flow
    left.data = np.where(left.data > 0, left.data, 0)
    left.eliminate_zeros()
    reached = breadth_first_order(csr_array(left), source, return_predecessors=False)
    is_object = np.zeros(count + 2, bool)
    is_object[reached] = True
    labels = np.zeros(domain.shape, bool)
    labels[domain] = is_object[:count]
    return labels
