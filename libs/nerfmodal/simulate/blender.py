"""Pictures of a simulated plant by Blender's Cycles: the only importer of bpy, and only inside functions.

The light of a frame does not depend on the view, so it is path-traced once a frame, onto the vertices ("baked": the
sky's HDRI, its shadows and one bounce), and a view only looks at it: views cost little and share one light. The noise
of the baked light keeps to its vertices and, with one Cycles seed for all frames, to its value: it is texture.
The ground's light is baked once, under the plant at rest: its shadow on the ground stands still, that on itself moves.
A scene is built once per process and mesh; a frame only moves the mesh's vertices, a view only the camera.
Blender's camera looks along -z with +y up, as `types.Camera` does; its lens is set from the focal length in pixels.
"""

import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int, UInt8
from PIL import Image

from nerfmodal.errors import MissingExtra
from nerfmodal.simulate.patches import grid_triangles
from nerfmodal.simulate.stage import CHECKER_SIDE, CHECKER_TONES, GROUND_HALF
from nerfmodal.types import Camera, Mesh

LEAST_THREADS = 2
"""With one thread the helper that Blender's scheduler (oneTBB) starts anyway finds its place taken and never sleeps: it
spins on another core for as long as a picture is drawn, and takes more of the processor than the picture."""
SENSOR_MM = 36.0
SKY = "sunrise.exr"
SKY_STRENGTH = 1.4
SKY_MAP = 2048
"""Resolution at which the sky's light is sampled: coarser, and the sun falls between the map's cells as sparks."""
PLANT_PATHS, GROUND_PATHS = 12, 24
"""Paths per triangle corner of the baked light; a vertex averages about six corners."""
PLAIN_RAYS = 64
"""A picture of more rays a pixel than this spends the others where pixels are still uncertain: on edges."""
LEAST_RAYS, NOISE = 16, 0.01
"""Of such a picture every pixel has so many rays, and gets no more once its noise (of 1) is estimated below this."""
UNDERSIDE = 0.62
"""Light that comes through a leaf, as a share of that on its upper side."""
NEAR_GROUND, NEAR_STEP = 2.4, 0.08
"""The ground's light is baked this finely (m) within this distance (m) of the plant."""


@contextmanager
def open_studio(mesh: Mesh, vertices: Float[np.ndarray, "vertices 3"], seed: int) -> Iterator["BlenderStudio"]:
    """A studio of `mesh` with its vertices at `vertices` (metres), where the sky shines on them.

    Raises `MissingExtra` without bpy.
    """
    with tempfile.TemporaryDirectory(prefix="nerfmodal-", dir=_memory_folder()) as folder:
        with _quiet_stdout():
            stage = _stage(_SameMesh(mesh))
            stage.prepare(vertices, seed)
        yield BlenderStudio(stage, Path(folder) / "view.png")


@dataclass(frozen=True, slots=True)
class BlenderStudio:
    """A structure in the one scene of this process; pictures pass through `file`."""

    stage: "_Stage"
    file: Path

    def move(self, vertices: Float[np.ndarray, "vertices 3"]) -> None:
        """Put the vertices there (metres); the light on them stays."""
        self.stage.place(vertices)

    def shoot(self, camera: Camera, samples: int) -> UInt8[np.ndarray, "height width 3"]:
        """What the camera sees, by `samples` paths a pixel."""
        with _quiet_stdout():
            self.stage.shoot(camera, samples, self.file)
        return _read(self.file)


@dataclass(frozen=True, slots=True)
class _Surface:
    """An object whose baked light its camera rays see."""

    item: Any
    nodes: Any

    def show(self, shader: str) -> None:
        """Use the real material ("Principled BSDF") or the baked light times the tint ("Emission")."""
        source = self.nodes.nodes[shader].outputs[0]
        self.nodes.links.new(source, self.nodes.nodes["Material Output"].inputs["Surface"])


@dataclass(frozen=True, slots=True)
class _Stage:
    """A Blender scene with one plant, the ground, a sky and one camera."""

    bpy: Any
    plant: _Surface
    ground: _Surface

    def prepare(self, vertices: Float[np.ndarray, "vertices 3"], seed: int) -> None:
        """Move the plant and let the sky shine on it."""
        self.place(vertices)
        self.bpy.context.scene.cycles.seed = seed % 2**31
        self.bake(self.plant, PLANT_PATHS)

    def place(self, vertices: Float[np.ndarray, "vertices 3"]) -> None:
        """Move the plant."""
        data = self.plant.item.data
        data.vertices.foreach_set("co", np.ascontiguousarray(vertices, dtype=np.float32).ravel())
        data.update()

    def bake(self, surface: _Surface, paths: int) -> None:
        """Path-trace the light on the surface's vertices."""
        self._arrange(lit=True)
        cycles = self.bpy.context.scene.cycles
        cycles.samples, cycles.use_adaptive_sampling = paths, False
        for item in (self.plant.item, self.ground.item):
            item.select_set(item is surface.item)
        self.bpy.context.view_layer.objects.active = surface.item
        self.bpy.ops.object.bake(type="DIFFUSE", pass_filter={"DIRECT", "INDIRECT"}, target="VERTEX_COLORS")
        self._arrange(lit=False)

    def _arrange(self, *, lit: bool) -> None:
        """Set the scene for baking (`lit`) or for pictures, whose light is baked: no ray bounces, no sky is sampled."""
        scene = self.bpy.context.scene
        # kept data would still hold the materials of the last picture, which give no light back
        scene.render.use_persistent_data = not lit
        scene.world.cycles.sampling_method = "MANUAL" if lit else "NONE"
        scene.cycles.max_bounces = 2 if lit else 0
        for surface in (self.plant, self.ground):
            surface.show("Principled BSDF" if lit else "Emission")

    def shoot(self, camera: Camera, samples: int, file: Path) -> None:
        """Take one picture."""
        scene = self.bpy.context.scene
        scene.cycles.samples = samples
        scene.cycles.use_adaptive_sampling = samples > PLAIN_RAYS
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
    bpy.context.scene.cycles.device = _device(bpy.context.preferences.addons["cycles"].preferences)
    _add_sky(bpy)
    _add_camera(bpy)
    stage = _Stage(bpy, _add_plant(bpy, plant.mesh), _add_ground(bpy))
    stage.bake(stage.ground, GROUND_PATHS)
    return stage


def forget_scene() -> None:
    """Let go of the scene that is kept between calls; the next frame builds its own."""
    _stage.cache_clear()


def _import_bpy() -> Any:
    try:
        import bpy
    except ImportError as missing:
        raise MissingExtra("bpy", "simulate") from missing
    return bpy


def _set_render(scene: Any) -> None:
    """Few bounces: the light is a sky, and the plant is seen for its motion."""
    render, cycles = scene.render, scene.cycles
    render.engine, render.resolution_percentage = "CYCLES", 100
    render.threads_mode, render.threads = "FIXED", _threads()
    render.image_settings.file_format, render.image_settings.color_mode = "PNG", "RGB"
    render.image_settings.compression = 0
    scene.view_settings.view_transform = "Standard"
    cycles.use_denoising = False
    cycles.adaptive_min_samples, cycles.adaptive_threshold = LEAST_RAYS, NOISE
    cycles.diffuse_bounces, cycles.glossy_bounces = 2, 1
    cycles.transmission_bounces, cycles.transparent_max_bounces = 1, 1
    cycles.caustics_reflective, cycles.caustics_refractive = False, False


def _threads() -> int:
    return max(int(os.environ.get("NERFMODAL_THREADS") or os.cpu_count() or 1), LEAST_THREADS)


def _device(preferences: Any) -> str:
    """ "GPU" where Cycles finds one, of whatever make, else "CPU"."""
    for make in ("OPTIX", "CUDA", "HIP", "ONEAPI", "METAL"):
        found = [device for device in _devices(preferences, make) if device.type == make]
        if found:
            preferences.compute_device_type = make
            for device in found:
                device.use = True
            return "GPU"
    return "CPU"


def _devices(preferences: Any, make: str) -> list[Any]:
    try:
        return list(preferences.get_devices_for_type(make))
    except (TypeError, ValueError):  # this build of Cycles does not know the make
        return []


def _add_plant(bpy: Any, mesh: Mesh) -> _Surface:
    surface = _add_surface(bpy, "plant", mesh.vertices, mesh.triangles)
    surface.item.data.shade_smooth()
    colors = surface.item.data.color_attributes.new("tint", "FLOAT_COLOR", "POINT")
    colors.data.foreach_set("color", np.insert(mesh.colors, 3, 1.0, axis=1).astype(np.float32).ravel())
    nodes = surface.nodes
    tint = nodes.nodes.new("ShaderNodeVertexColor")
    tint.layer_name = "tint"
    sides = nodes.nodes.new("ShaderNodeMapRange")
    sides.inputs["To Min"].default_value, sides.inputs["To Max"].default_value = 1.0, UNDERSIDE
    nodes.links.new(nodes.nodes.new("ShaderNodeNewGeometry").outputs["Backfacing"], sides.inputs["Value"])
    nodes.links.new(sides.outputs["Result"], nodes.nodes["Emission"].inputs["Strength"])
    _paint(surface, tint.outputs["Color"])
    return surface


def _add_ground(bpy: Any) -> _Surface:
    near = np.arange(-NEAR_GROUND, NEAR_GROUND + NEAR_STEP / 2, NEAR_STEP)
    lines = np.concatenate([[-GROUND_HALF, -6.0, -3.5], near, [3.5, 6.0, GROUND_HALF]])
    y, x = np.meshgrid(lines, lines, indexing="ij")
    vertices = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    surface = _add_surface(bpy, "ground", vertices, grid_triangles(len(lines), len(lines)))
    nodes = surface.nodes
    place, checker = nodes.nodes.new("ShaderNodeTexCoord"), nodes.nodes.new("ShaderNodeTexChecker")
    checker.inputs["Scale"].default_value = 1 / CHECKER_SIDE
    for name, tone in zip(("Color1", "Color2"), CHECKER_TONES, strict=True):
        checker.inputs[name].default_value = (tone, tone, tone, 1.0)
    nodes.links.new(place.outputs["Object"], checker.inputs["Vector"])
    _paint(surface, checker.outputs["Color"])
    return surface


def _add_surface(
    bpy: Any, name: str, vertices: Float[np.ndarray, "vertices 3"], triangles: Int[np.ndarray, "triangles 3"]
) -> _Surface:
    data, material = bpy.data.meshes.new(name), bpy.data.materials.new(name)
    data.from_pydata(vertices.tolist(), [], triangles.tolist())
    data.color_attributes.new("light", "FLOAT_COLOR", "POINT")
    data.color_attributes.active_color = data.color_attributes["light"]
    material.use_nodes = True
    data.materials.append(material)
    item = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(item)
    nodes = material.node_tree
    shader = nodes.nodes["Principled BSDF"]
    shader.inputs["Roughness"].default_value, shader.inputs["Specular IOR Level"].default_value = 1.0, 0.0
    nodes.nodes.new("ShaderNodeEmission")
    return _Surface(item, nodes)


def _paint(surface: _Surface, tint: Any) -> None:
    """The tint is the reflectance where light falls and multiplies the baked light where a camera looks."""
    nodes = surface.nodes
    light, product = nodes.nodes.new("ShaderNodeVertexColor"), nodes.nodes.new("ShaderNodeVectorMath")
    light.layer_name, product.operation = "light", "MULTIPLY"
    nodes.links.new(tint, nodes.nodes["Principled BSDF"].inputs["Base Color"])
    nodes.links.new(tint, product.inputs[0])
    nodes.links.new(light.outputs["Color"], product.inputs[1])
    nodes.links.new(product.outputs["Vector"], nodes.nodes["Emission"].inputs["Color"])


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
    world.cycles.sample_map_resolution = SKY_MAP
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
