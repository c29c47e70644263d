"""Pictures of a simulated plant by Blender's Cycles: the only importer of bpy, and only inside functions.

A scene is built once per process and mesh; a frame only moves the mesh's vertices, a view only the camera.
Every picture uses the same Cycles seed: a pixel that nothing changes keeps its value from frame to frame.
Blender's camera looks along -z with +y up, as `types.Camera` does; its lens is set from the focal length in pixels.
"""

import os
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, UInt8
from PIL import Image

from nerfmodal.errors import MissingExtra
from nerfmodal.geometry.cameras import semi_spherical_rig
from nerfmodal.simulate.motion import frame_times, plant_of, vertices_at
from nerfmodal.simulate.stage import CHECKER_SIDE, CHECKER_TONES, GROUND_HALF, check_rig
from nerfmodal.spec import SimulationSource
from nerfmodal.types import Camera, Frame, Mesh

SENSOR_MM = 36.0
SKY = "sunset.exr"
SKY_STRENGTH = 0.8


def render_frame(source: SimulationSource, index: int, seed: int, *, report: Callable[[int, int], None]) -> Frame:
    """All views of frame `index`, rendered by Cycles.

    `report(done, total)` is called after each view; what it raises stops the rendering.
    Raises `MissingExtra` without bpy and `InvalidSpec` for modes or cameras that cannot be.
    """
    plant, rig = plant_of(source), semi_spherical_rig(source.rig)
    check_rig(rig, plant)
    time = float(frame_times(source)[index])
    vertices = vertices_at(plant, source, time)
    images = render_views(plant.mesh, vertices, rig.cameras, samples=source.samples, seed=seed, report=report)
    return Frame(index=index, time=time, images=images, rig=rig)


def render_views(
    mesh: Mesh,
    vertices: Float[np.ndarray, "vertices 3"],
    cameras: tuple[Camera, ...],
    *,
    samples: int,
    seed: int,
    report: Callable[[int, int], None],
) -> UInt8[np.ndarray, "cameras height width 3"]:
    """Pictures of `mesh` with its vertices moved to `vertices` (metres). Raises `MissingExtra`."""
    pictures = []
    with tempfile.TemporaryDirectory(prefix="nerfmodal-", dir=_memory_folder()) as folder:
        file = Path(folder) / "view.png"
        with _quiet_stdout():
            stage = _stage(_SameMesh(mesh))
            stage.prepare(vertices, samples, seed)
        for done, camera in enumerate(cameras, start=1):
            with _quiet_stdout():
                stage.shoot(camera, file)
            pictures.append(_read(file))
            report(done, len(cameras))
    return np.stack(pictures)


@dataclass(frozen=True, slots=True)
class _Stage:
    """A Blender scene with one plant, the ground, a sky and one camera."""

    bpy: Any
    mesh: Any

    def prepare(self, vertices: Float[np.ndarray, "vertices 3"], samples: int, seed: int) -> None:
        self.mesh.vertices.foreach_set("co", np.ascontiguousarray(vertices, dtype=np.float32).ravel())
        self.mesh.update()
        cycles = self.bpy.context.scene.cycles
        cycles.samples, cycles.seed = samples, seed % 2**31

    def shoot(self, camera: Camera, file: Path) -> None:
        scene = self.bpy.context.scene
        scene.render.resolution_x, scene.render.resolution_y = camera.width, camera.height
        lens = scene.camera.data
        lens.lens = camera.focal_x * SENSOR_MM / camera.width
        lens.shift_x = (camera.width / 2 - camera.center_x) / camera.width
        lens.shift_y = (camera.center_y - camera.height / 2) / camera.width
        scene.camera.matrix_world = camera.camera_to_world.T.tolist()
        scene.render.filepath = str(file)
        self.bpy.ops.render.render(write_still=True)


@dataclass(frozen=True, slots=True, eq=False)
class _SameMesh:
    """A mesh that equals only itself, so that a scene can be cached by it."""

    mesh: Mesh

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _SameMesh) and other.mesh is self.mesh

    def __hash__(self) -> int:
        return id(self.mesh)


@lru_cache(maxsize=1)
def _stage(plant: _SameMesh) -> _Stage:
    """Build the scene. Blender has one scene at a time in a process, so only the last is kept."""
    bpy = _import_bpy()
    bpy.ops.wm.read_factory_settings(use_empty=True)
    _set_render(bpy.context.scene)
    _add_ground(bpy)
    _add_sky(bpy)
    _add_camera(bpy)
    return _Stage(bpy, _add_plant(bpy, plant.mesh))


def _import_bpy() -> Any:
    try:
        import bpy
    except ImportError as missing:
        raise MissingExtra("bpy", "simulate") from missing
    return bpy


def _set_render(scene: Any) -> None:
    """Few bounces: the light is a sky, and the plant is seen for its motion."""
    render, cycles = scene.render, scene.cycles
    render.engine, render.use_persistent_data, render.resolution_percentage = "CYCLES", True, 100
    render.threads_mode, render.threads = "FIXED", int(os.environ.get("NERFMODAL_THREADS") or os.cpu_count() or 1)
    render.image_settings.file_format, render.image_settings.color_mode = "PNG", "RGB"
    render.image_settings.compression = 0
    scene.view_settings.view_transform = "Standard"
    cycles.device, cycles.use_denoising, cycles.use_adaptive_sampling = "CPU", True, False
    cycles.max_bounces, cycles.diffuse_bounces, cycles.glossy_bounces = 2, 2, 1
    cycles.transmission_bounces, cycles.transparent_max_bounces = 1, 1
    cycles.caustics_reflective, cycles.caustics_refractive = False, False
    cycles.sample_clamp_direct, cycles.sample_clamp_indirect = 1.5, 1.0


def _add_plant(bpy: Any, mesh: Mesh) -> Any:
    data = bpy.data.meshes.new("plant")
    data.from_pydata(mesh.vertices.tolist(), [], mesh.triangles.tolist())
    data.shade_smooth()
    colors = data.color_attributes.new("tint", "FLOAT_COLOR", "POINT")
    colors.data.foreach_set("color", np.insert(mesh.colors, 3, 1.0, axis=1).astype(np.float32).ravel())
    material, shader, nodes = _new_material(bpy, "plant", roughness=0.6)
    color = nodes.nodes.new("ShaderNodeVertexColor")
    color.layer_name = "tint"
    nodes.links.new(color.outputs["Color"], shader.inputs["Base Color"])
    data.materials.append(material)
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("plant", data))
    return data


def _add_ground(bpy: Any) -> None:
    data = bpy.data.meshes.new("ground")
    h = GROUND_HALF
    data.from_pydata([(-h, -h, 0), (h, -h, 0), (h, h, 0), (-h, h, 0)], [], [(0, 1, 2, 3)])
    material, shader, nodes = _new_material(bpy, "ground", roughness=1.0)
    shader.inputs["Specular IOR Level"].default_value = 0.0
    place, checker = nodes.nodes.new("ShaderNodeTexCoord"), nodes.nodes.new("ShaderNodeTexChecker")
    checker.inputs["Scale"].default_value = 1 / CHECKER_SIDE
    for name, tone in zip(("Color1", "Color2"), CHECKER_TONES, strict=True):
        checker.inputs[name].default_value = (tone, tone, tone, 1.0)
    nodes.links.new(place.outputs["Object"], checker.inputs["Vector"])
    nodes.links.new(checker.outputs["Color"], shader.inputs["Base Color"])
    data.materials.append(material)
    bpy.context.scene.collection.objects.link(bpy.data.objects.new("ground", data))


def _new_material(bpy: Any, name: str, *, roughness: float) -> tuple[Any, Any, Any]:
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    shader = material.node_tree.nodes["Principled BSDF"]
    shader.inputs["Roughness"].default_value = roughness
    return material, shader, material.node_tree


def _add_sky(bpy: Any) -> None:
    world = bpy.data.worlds.new("sky")
    world.use_nodes = True
    nodes = world.node_tree
    picture = nodes.nodes.new("ShaderNodeTexEnvironment")
    folder = Path(bpy.utils.resource_path("LOCAL")) / "datafiles" / "studiolights" / "world"
    picture.image = bpy.data.images.load(str(folder / SKY))
    background = nodes.nodes["Background"]
    background.inputs["Strength"].default_value = SKY_STRENGTH
    nodes.links.new(picture.outputs["Color"], background.inputs["Color"])
    world.cycles.sampling_method, world.cycles.sample_map_resolution = "MANUAL", 512
    bpy.context.scene.world = world


def _add_camera(bpy: Any) -> None:
    lens = bpy.data.cameras.new("camera")
    lens.sensor_fit, lens.sensor_width, lens.clip_start = "HORIZONTAL", SENSOR_MM, 0.01
    camera = bpy.data.objects.new("camera", lens)
    bpy.context.scene.collection.objects.link(camera)
    bpy.context.scene.camera = camera


def _read(file: Path) -> UInt8[np.ndarray, "height width 3"]:
    with Image.open(file) as picture:
        return np.asarray(picture.convert("RGB"))


def _memory_folder() -> str | None:
    """Pictures pass through memory where the system offers a file system of it."""
    return "/dev/shm" if os.access("/dev/shm", os.W_OK) else None


@contextmanager
def _quiet_stdout() -> Iterator[None]:
    """Blender prints to file descriptor 1, where the process may be speaking JSON."""
    sys.stdout.flush()
    kept, nowhere = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    try:
        yield
    finally:
        sys.stdout.flush()
        os.dup2(kept, 1)
        os.close(kept)
        os.close(nowhere)
