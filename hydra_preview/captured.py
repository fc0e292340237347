"""A capture, shown over the asset that was made of it: its cloud, its cameras."""

from lighting import PREVIEW_ROOT
from pxr import Gf, Sdf, Usd, UsdGeom, Vt

CAPTURE = f"{PREVIEW_ROOT}/Capture"
CAMERAS = f"{PREVIEW_ROOT}/Cameras"
DEPTH = 0.04  # of the stage's size: how far a camera's pyramid reaches
COLOR = (0.9, 0.55, 0.1)


def add_capture(stage: Usd.Stage, capture: str, plant: Usd.Prim) -> None:
    """Lay the layer of a capture over the plant, by its foliage:captureToAsset."""
    authored = plant.GetAttribute("foliage:captureToAsset").Get()
    matrix = Gf.Matrix4d(authored) if authored is not None else Gf.Matrix4d(1)
    # The layer is in metres already, where the matrix brings the input's own unit to metres.
    matrix = matrix.RemoveScaleShear()
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        root = UsdGeom.Xform.Define(stage, CAPTURE)
        root.GetPrim().GetReferences().AddReference(capture)
        root.MakeMatrixXform().Set(matrix * plant_matrix(plant))
        # In a plant's asset the scope has this purpose; a capture that is looked at alone would be blank with it.
        guides = stage.OverridePrim(f"{CAPTURE}/geo/guide")
        UsdGeom.Imageable(guides).CreatePurposeAttr(UsdGeom.Tokens.guide)


def plant_matrix(plant: Usd.Prim) -> Gf.Matrix4d:
    return UsdGeom.XformCache().GetLocalToWorldTransform(plant)


def show_cameras(stage: Usd.Stage, visible: bool) -> None:
    """Draw a pyramid for every camera of the stage, since Storm draws none, or remove the pyramids."""
    with Usd.EditContext(stage, stage.GetSessionLayer()):
        stage.RemovePrim(CAMERAS)
        if visible:
            _author_pyramids(stage)


def _author_pyramids(stage: Usd.Stage) -> None:
    cameras = [prim for prim in stage.Traverse() if prim.IsA(UsdGeom.Camera)]
    if not cameras:
        return
    bounds = UsdGeom.BBoxCache(Usd.TimeCode.EarliestTime(), ["default", "render", "proxy"], useExtentsHint=False)
    depth = DEPTH * bounds.ComputeWorldBound(stage.GetPseudoRoot()).ComputeAlignedRange().GetSize().GetLength()
    points = []
    for prim in cameras:
        frustum = UsdGeom.Camera(prim).GetCamera(Usd.TimeCode.EarliestTime()).frustum
        apex, corners = frustum.position, frustum.ComputeCornersAtDistance(depth)
        low_left, low_right, high_left, high_right = corners
        for corner in corners:
            points += [apex, corner]
        for first, second in (
            (low_left, low_right),
            (low_right, high_right),
            (high_right, high_left),
            (high_left, low_left),
        ):
            points += [first, second]
    lines = UsdGeom.BasisCurves.Define(stage, Sdf.Path(CAMERAS))
    lines.CreateTypeAttr(UsdGeom.Tokens.linear)
    lines.CreateCurveVertexCountsAttr(Vt.IntArray(len(points) // 2, 2))
    vertices = Vt.Vec3fArray([Gf.Vec3f(point) for point in points])
    lines.CreatePointsAttr(vertices)
    lines.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(vertices))
    lines.CreateDisplayColorAttr([Gf.Vec3f(*COLOR)])
    lines.CreateWidthsAttr([depth * 0.03])
    lines.SetWidthsInterpolation(UsdGeom.Tokens.constant)
