"""What is true of the leaves of a synthetic capture, in the capture's frame."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from usdfoliage.leaf.shape.measures import leaf_width
from usdfoliage.leaf.shape.surface import evaluate_grid

from tools.synthetic.curve_lengths import curve_length
from tools.synthetic.depth import SeenDepth
from tools.synthetic.scene import Scene

UP_AXES: Mapping[str, NDArray[np.float64]] = {  # the capture's frame from the scene's
    "Y": np.eye(3),
    "Z": np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]),
}


def describe_leaves(
    scene: Scene, seen: Sequence[SeenDepth], capture_from_scene: NDArray[np.float64]
) -> dict[str, NDArray[np.generic]]:
    """The arrays of leaves.npz, in the capture's frame."""
    leaves, count = scene.leaves, len(scene.leaves)
    matrix = capture_from_scene @ leaves.asset_from_leaf()
    base, apex = matrix[:, :, 3], matrix[:, :, 3] + matrix[:, :, 1]
    at_base = evaluate_grid(leaves.parameters, [0.0], [1e-3])
    tangent = _unit(np.einsum("nij,nj->ni", matrix[:, :, :3], at_base.tangents_v[:, 0, 0]))
    upper = _unit(np.einsum("nij,nj->ni", matrix[:, :, :3], at_base.normals[:, 0, 0]))
    lateral = _unit(np.cross(upper, tangent))
    transform = np.tile(np.eye(4), (count, 1, 1))
    transform[:, :3] = np.stack([tangent, lateral, np.cross(tangent, lateral), base], axis=-1)
    vertices = scene.points_m[: count * scene.vertices_a_leaf] @ capture_from_scene.T
    faces = scene.triangles[: scene.triangles_a_leaf]  # those of the first leaf
    pixels = np.stack([np.bincount(view.leaf_id.ravel(), minlength=count + 1)[1:] for view in seen], axis=1)
    return {
        "id": np.arange(1, count + 1, dtype=np.int32),
        "base": base.astype(np.float32),
        "apex": apex.astype(np.float32),
        "length": (curve_length(leaves.parameters, 0.0) * leaves.length_m).astype(np.float32),
        "chord": leaves.length_m.astype(np.float32),
        "width": (leaf_width(leaves.parameters) * leaves.length_m).astype(np.float32),
        "transform": transform.astype(np.float32),
        "vertices": vertices.astype(np.float32),
        "vertex_offset": np.arange(count + 1, dtype=np.int64) * scene.vertices_a_leaf,
        "faces": np.tile(faces, (count, 1)),
        "face_offset": np.arange(count + 1, dtype=np.int64) * scene.triangles_a_leaf,
        "visible_pixels": pixels.astype(np.int32),
        "parameters": leaves.parameters,
        "orientation": _turn(capture_from_scene, leaves.orientation),
    }


def _turn(rotation: NDArray[np.float64], orientation: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray((Rotation.from_matrix(rotation) * Rotation.from_quat(orientation)).as_quat(canonical=True))


def _unit(vectors: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.asarray(vectors / np.linalg.norm(vectors, axis=-1, keepdims=True))
