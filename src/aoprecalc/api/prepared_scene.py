"""A scene as light is measured in it: with its roles, its poses, what surrounds it, its details and its normals."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

from aoprecalc.api.high_to_low import with_detail
from aoprecalc.api.surroundings import with_surroundings
from aoprecalc.io.meshes import scene_in_pose
from aoprecalc.mesh.roles import assign_roles, up_axis
from aoprecalc.mesh.surface import default_crease_angle, shading_normals
from aoprecalc.options import BakeOptions, ValueOptions
from aoprecalc.options.fields import option_fields
from aoprecalc.types import Float32Array, Scene


@dataclass(frozen=True, eq=False)
class PreparedScene:
    """A scene that is ready to be measured; several textures of it share that.

    scene     with the roles of its parts, what surrounds it, its poses and its details, and messages about them
    normals   (f, 3, 3) float32: its shading normals at the corners
    """

    scene: Scene
    normals: Float32Array

    @classmethod
    def of(cls, scene: Scene, options: ValueOptions, threads: int, high: Sequence[Scene] = ()) -> Self:
        """Prepare a scene whose parts have their roles; see `assign_roles`.

        threads   that look for the cage of details, 0 is one for each core
        high      detailed meshes in memory, in the place of the files that `options` name
        Raises what `with_surroundings`, `with_poses`, `with_detail` and `shading_normals` raise.
        """
        posed = with_poses(with_surroundings(scene, options), options)
        detailed = with_detail(posed, options, threads, high)
        return cls(detailed, shading_normals(detailed, options.normals, options.crease_angle))


def prepare_bake(scene: Scene, options: BakeOptions, high: Sequence[Scene] = ()) -> PreparedScene:
    """Prepare a scene for a bake, which gives its parts their roles; see `PreparedScene.of`."""
    with_roles = assign_roles(scene, options, share=options.instances == "share")
    return PreparedScene.of(with_roles, options, options.threads, high)


def value_options(scene: Scene, options: BakeOptions) -> ValueOptions:
    """Return the options of a bake that define its value, also for copies of the mesh in other formats.

    So the axis that points up is named, and the crease angle of STL.
    """
    value = ValueOptions(**{field.name: getattr(options, field.name) for field in option_fields(ValueOptions)})
    if value.has_up:
        value = replace(value, up=up_axis(scene, options))
    if value.crease_angle is None and scene.format == "stl":
        value = replace(value, crease_angle=default_crease_angle(scene))
    return value


# The poses of files.


def with_poses(scene: Scene, options: ValueOptions) -> Scene:
    """Return a scene with the poses that options name, each once, in the order of their names, and their warnings.

    The mesh of a bake has its poses already, as its file is not there to be asked.
    Raises ArgumentError where the file has no such pose, InputError where its animations are damaged.
    """
    known = {} if scene.format else scene.poses
    poses = {name: known.get(name) or scene_in_pose(scene, name) for name in sorted(set(options.pose))}
    warnings = dict.fromkeys((*scene.warnings, *(line for pose in poses.values() for line in pose.warnings)))
    shaded = {
        name: replace(pose, normals=shading_normals(pose, options.normals, options.crease_angle))
        for name, pose in poses.items()
    }
    return replace(scene, poses=shaded, warnings=tuple(warnings))


def standing(scene: Scene, pose: str, options: ValueOptions) -> Scene:
    """Return a scene as it stands in one pose, for pictures: the rest is as in its file.

    options   say which shading normals it has
    Raises what `with_poses` raises.
    """
    posed = with_poses(scene, replace(options, pose=(pose,)))
    stands = posed.poses[pose]
    return replace(posed, positions=stands.positions, faces=stands.faces, normals=stands.normals)
