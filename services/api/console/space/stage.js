/**
 * Points in space on a canvas: turned under the mouse, with fingers or by keys, swinging in a mode's shape.
 *
 * The GPU moves the points: base position plus a number times the shape. Per picture that number is all that JavaScript
 * sets, however many points there are.
 */
import * as THREE from "../vendor/three.module.min.js";
import { OrbitControls } from "../vendor/orbit.js";
import { adaptive } from "./adapt.js";

const MEASURED_MS = 1000;
const TURN = 0.12; // radians of one key press
const ZOOM = 1.12;
const [SMALLEST, LARGEST, FILLING] = [0.0022, 0.012, 0.7]; // of a point, as a share of the extent
const VIEW = [0.72, -1.1, 0.36]; // where the camera stands at first, in extents from the middle
const VERTEX = `
attribute vec3 motion;
attribute vec3 colour;
uniform float swing, longest, tint, size, scale;
varying vec3 shade;
vec3 cividis(float share) {
  vec3 low = vec3(0.0, 0.133, 0.306), middle = vec3(0.486, 0.482, 0.471), high = vec3(0.996, 0.910, 0.220);
  return share < 0.5 ? mix(low, middle, 2.0 * share) : mix(middle, high, 2.0 * share - 1.0);
}
void main() {
  vec4 seen = modelViewMatrix * vec4(position + swing * motion, 1.0);
  gl_Position = projectionMatrix * seen;
  gl_PointSize = max(1.5, size * scale / -seen.z);
  shade = mix(colour, cividis(length(motion) / longest), tint);
}`;
const FRAGMENT = `
varying vec3 shade;
void main() {
  vec2 from = gl_PointCoord - 0.5;
  if (dot(from, from) > 0.25) discard;
  gl_FragColor = vec4(shade, 1.0);
}`;

/** Throws where the browser has no WebGL. `onRate({fps, shown, all})` tells once a second while something moves. */
export function createStage(canvas, { onRate = () => {} } = {}) {
  const renderer = new THREE.WebGLRenderer({
    canvas,
    antialias: false,
    alpha: true,
    powerPreference: "high-performance",
  });
  const scene = new THREE.Scene();
  const camera = new THREE.PerspectiveCamera(40, 1, 0.01, 1000);
  camera.up.set(0, 0, 1);
  const controls = new OrbitControls(camera, canvas);
  const material = new THREE.ShaderMaterial({
    vertexShader: VERTEX,
    fragmentShader: FRAGMENT,
    uniforms: Object.fromEntries(
      [
        ["swing", 0],
        ["longest", 1],
        ["tint", 0],
        ["size", 0.01],
        ["scale", 1],
      ].map(([key, value]) => [key, { value }]),
    ),
  });
  const uniform = material.uniforms;
  const play = { on: false, amplitude: 0.08, period: 2 };
  let [cloud, extent, budget, phase, asked, disposed] = [null, 1, adaptive(0), 0, 0, false];
  let [last, counted, since] = [0, 0, 0];

  function draw(now) {
    asked = 0;
    if (disposed) return;
    if (play.on) phase += (2 * Math.PI * Math.min(now - last, 250)) / 1000 / play.period;
    last = now;
    uniform.swing.value = (Math.sin(phase) * play.amplitude * extent) / uniform.longest.value;
    renderer.render(scene, camera);
    if (play.on) {
      measure(now);
      ask();
    }
  }

  function measure(now) {
    if (!since) [since, counted] = [now, 0];
    else counted++;
    if (now - since < MEASURED_MS) return;
    const fps = (1000 * counted) / (now - since);
    [since, counted] = [now, 0];
    budget.next(fps);
    onRate({ fps, ...limit() });
  }

  /** Draw as many points as there is time for, larger where they are fewer: the surface keeps its look. */
  function limit() {
    const [shown, all] = [budget.shown, cloud?.geometry.attributes.position.count ?? 0];
    cloud?.geometry.setDrawRange(0, shown);
    const count = Math.max(1, Math.min(shown, all));
    uniform.size.value = Math.min(LARGEST, Math.max(SMALLEST, FILLING / Math.sqrt(count))) * extent;
    return { shown, all };
  }

  const ask = () => (asked ||= requestAnimationFrame(draw));
  const restart = () => {
    since = 0;
    last = performance.now();
    ask();
  };

  function resize() {
    const { clientWidth: width, clientHeight: height } = canvas;
    if (!width || !height) return;
    renderer.setPixelRatio(Math.min(devicePixelRatio, 2));
    renderer.setSize(width, height, false);
    camera.aspect = width / height;
    camera.updateProjectionMatrix();
    uniform.scale.value = (height * renderer.getPixelRatio()) / (2 * Math.tan((camera.fov * Math.PI) / 360));
    ask();
  }

  function look(positions) {
    const box = new THREE.Box3().setFromArray(positions);
    const center = box.getCenter(new THREE.Vector3());
    extent = box.getSize(new THREE.Vector3()).length() || 1;
    camera.near = extent / 200;
    camera.far = extent * 20;
    camera.position.set(...VIEW.map((share, axis) => center.getComponent(axis) + share * extent));
    camera.updateProjectionMatrix();
    controls.target.copy(center);
    controls.update();
  }

  /** Points as flat arrays; the camera stays unless `keepView` is false. */
  function setPoints(positions, colours, { keepView = false } = {}) {
    const count = positions.length / 3;
    const geometry = new THREE.BufferGeometry();
    geometry.setAttribute("position", new THREE.BufferAttribute(positions, 3));
    geometry.setAttribute("colour", new THREE.BufferAttribute(colours, 3, true));
    geometry.setAttribute("motion", new THREE.BufferAttribute(new Float32Array(positions.length), 3));
    if (cloud) {
      scene.remove(cloud);
      cloud.geometry.dispose();
    }
    cloud = new THREE.Points(geometry, material);
    cloud.frustumCulled = false;
    scene.add(cloud);
    if (!keepView) look(positions);
    budget = adaptive(count, keepView ? budget.shown || count : count);
    limit();
    restart();
  }

  /** The shape of the mode at every point, metres for a coordinate of 1; null stands still. */
  function setMotion(motion) {
    const attribute = cloud.geometry.attributes.motion;
    attribute.array.fill(0);
    if (motion) attribute.array.set(motion);
    attribute.needsUpdate = true;
    uniform.longest.value = longestOf(attribute.array) || 1;
    restart();
  }

  /** `amplitude` as a share of the extent, `period` in seconds on the screen, `tint` 0 or 1, `on`. */
  function set({ tint, ...changes }) {
    Object.assign(play, changes);
    if (tint !== undefined) uniform.tint.value = tint;
    restart();
  }

  function onKey(event) {
    const turns = { ArrowLeft: [TURN, 0], ArrowRight: [-TURN, 0], ArrowUp: [0, -TURN], ArrowDown: [0, TURN] }[
      event.key
    ];
    const zoom = { "+": 1 / ZOOM, "=": 1 / ZOOM, "-": ZOOM }[event.key];
    if (!turns && !zoom) return;
    event.preventDefault();
    const offset = camera.position.clone().sub(controls.target);
    const away = offset.length() * (zoom ?? 1);
    const yaw = Math.atan2(offset.y, offset.x) + (turns?.[0] ?? 0);
    const polar = Math.min(3.1, Math.max(0.04, Math.acos(offset.z / offset.length()) + (turns?.[1] ?? 0)));
    offset.set(Math.sin(polar) * Math.cos(yaw), Math.sin(polar) * Math.sin(yaw), Math.cos(polar)).multiplyScalar(away);
    camera.position.copy(controls.target).add(offset);
    controls.update();
  }

  const observer = new ResizeObserver(resize);
  observer.observe(canvas);
  controls.addEventListener("change", ask);
  canvas.addEventListener("keydown", onKey);
  resize();
  return {
    setPoints,
    setMotion,
    set,
    dispose() {
      disposed = true;
      cancelAnimationFrame(asked);
      observer.disconnect();
      controls.dispose();
      canvas.removeEventListener("keydown", onKey);
      cloud?.geometry.dispose();
      material.dispose();
      renderer.dispose();
    },
  };
}

export function longestOf(motion) {
  let longest = 0;
  for (let k = 0; k < motion.length; k += 3)
    longest = Math.max(longest, motion[k] ** 2 + motion[k + 1] ** 2 + motion[k + 2] ** 2);
  return Math.sqrt(longest);
}
