"""Write USD: one rigid body in frame O with UsdPhysics, its shape in the file; metres, kg, z up.

O is the frame of the object's shape file.

In MassAPI, `centerOfMass` is in the prim's frame, and `diagonalInertia` about it along `principalAxes`, a
quaternion that rotates the prim's axes into the principal ones; all in single precision (openusd.org,
UsdPhysics: Mass Properties).
"""

# pxr is only partly typed.
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false
# pyright: reportUnknownMemberType=false, reportAttributeAccessIssue=false

from __future__ import annotations

import errno
import json
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from analyze.export.body import ExportBody
from analyze.export.provenance import printable
from schemas.object_spec import Box, Cylinder

if TYPE_CHECKING:
    from pxr import Usd

SHAPE = "shape"
METADATA = "percuss"


def write_usd(body: ExportBody, path: Path) -> None:
    """Write the USD file of a body.

    Args:
        body: exported body.
        path: the file, replaced if it exists; its suffix (.usda, .usd, .usdc) selects text or binary
            encoding.

    Raises:
        OSError: the file cannot be written.
    """
    from pxr import Gf, Sdf, Tf, Usd, UsdGeom, UsdPhysics

    layer = Sdf.Layer.CreateAnonymous(path.suffix)
    stage = Usd.Stage.Open(layer)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.z)
    UsdPhysics.SetStageKilogramsPerUnit(stage, 1.0)
    prim = UsdGeom.Xform.Define(stage, f"/{body.identifier}").GetPrim()
    stage.SetDefaultPrim(prim)
    # On the prim, not the layer, so that it stays with the body when another stage refers to it.
    prim.SetCustomDataByKey(METADATA, {key: _text(value) for key, value in body.provenance.items()})
    UsdPhysics.RigidBodyAPI.Apply(prim)
    moments, wxyz = body.inertial.principal_quaternion()
    own = UsdPhysics.MassAPI.Apply(prim)
    own.CreateMassAttr(body.inertial.mass)
    own.CreateCenterOfMassAttr(Gf.Vec3f(*body.inertial.com.tolist()))
    own.CreateDiagonalInertiaAttr(Gf.Vec3f(*moments.tolist()))
    own.CreatePrincipalAxesAttr(Gf.Quatf(*wxyz.tolist()))
    UsdPhysics.CollisionAPI.Apply(_shape(stage, f"/{body.identifier}/{SHAPE}", body))
    try:
        layer.Export(str(path))
    except Tf.ErrorException as error:  # does not carry the operating system's reason
        raise OSError(errno.EIO, "usd-core could not write it", str(path)) from error


def _text(value: object) -> str:
    """Text of a JSON value, for USD's dictionaries, which hold no null and no nested lists.

    Text stays text, other values become JSON; characters that cannot be seen are escaped.
    """
    return printable(
        value if isinstance(value, str) else json.dumps(value, ensure_ascii=False, allow_nan=False)
    )


def _shape(stage: Usd.Stage, path: str, body: ExportBody) -> Usd.Prim:
    """Define a body's exterior in a USD stage (scene), for display and collision, and return its prim.

    A prim is an element of the stage; `path` is its place there.
    """
    from pxr import Gf, UsdGeom, UsdPhysics, Vt

    match body.model.primitive:
        case Box(size_m=size):
            cube = UsdGeom.Cube.Define(stage, path)
            cube.CreateSizeAttr(1.0)
            cube.CreateExtentAttr([(-0.5, -0.5, -0.5), (0.5, 0.5, 0.5)])
            cube.AddScaleOp(UsdGeom.XformOp.PrecisionDouble).Set(Gf.Vec3d(*size))
            return cube.GetPrim()
        case Cylinder(radius_m=r, height_m=height):
            cylinder = UsdGeom.Cylinder.Define(stage, path)
            cylinder.CreateRadiusAttr(r)
            cylinder.CreateHeightAttr(height)
            cylinder.CreateAxisAttr(UsdGeom.Tokens.z)
            cylinder.CreateExtentAttr([(-r, -r, -height / 2), (r, r, height / 2)])
            return cylinder.GetPrim()
        case None:
            model = body.model
            mesh = UsdGeom.Mesh.Define(stage, path)
            mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(model.vertices.astype(np.float32)))
            mesh.CreateFaceVertexCountsAttr(
                Vt.IntArray.FromNumpy(np.full(len(model.faces), 3, dtype=np.int32))
            )
            mesh.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(model.faces.ravel().astype(np.int32)))
            mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)
            mesh.CreateOrientationAttr(UsdGeom.Tokens.rightHanded)
            mesh.CreateExtentAttr(Vt.Vec3fArray.FromNumpy(model.bounds.astype(np.float32)))
            collision = UsdPhysics.MeshCollisionAPI.Apply(mesh.GetPrim())
            # PhysX simulates convex bodies only.
            collision.CreateApproximationAttr(
                UsdPhysics.Tokens.convexHull if model.is_convex else UsdPhysics.Tokens.convexDecomposition
            )
            return mesh.GetPrim()
