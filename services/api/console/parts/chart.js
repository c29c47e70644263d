/**
 * Line charts and scatter on uPlot, in the page's colours: error bars, upright marks, a logarithmic axis, a zoom by
 * dragging (double click undoes it). Each chart says in words what it shows, and its numbers can be copied.
 */
import uPlot from "../vendor/uplot.js";
import { html, useEffect, useRef } from "../app/html.js";
import { useTheme } from "../app/hooks.js";
import { colour } from "../app/theme.js";
import { DRAWERS } from "./shapes.js";

export const HUES = ["blue", "vermillion", "green", "purple", "yellow", "grey"];
export const SHAPES = ["disc", "square", "diamond", "triangle", "cross", "ring"];
const SAFE = 1e-300;

/**
 * Series: {label, y, hue, shape?, line = true, std?, dash?}; marks: {x, label, hue, dash?, width_x?} upright lines;
 * levels: {y, hue, dash} lying lines. `x` is shared and ascending; `time` says that it is unix seconds.
 */
export function Chart({
  title,
  x,
  series,
  xLabel,
  yLabel,
  time = false,
  log = false,
  marks = [],
  levels = [],
  height = 220,
  yRange,
  xRange,
  legend = true,
  onPoint,
}) {
  const box = useRef(null);
  const theme = useTheme();
  const key = JSON.stringify([
    x.length,
    x[0],
    x.at(-1),
    series.map((one) => [one.label, one.y.length, one.y.find((v) => v != null), one.hue]),
    marks,
    levels,
    yRange,
    xRange,
    log,
  ]);
  useEffect(() => {
    const width = box.current.clientWidth || 600;
    const plot = new uPlot(
      optionsOf({ series, xLabel, yLabel, time, log, marks, levels, height, yRange, xRange, legend, width, onPoint }),
      [x, ...series.map((one) => (log ? one.y.map((v) => (v > 0 ? v : null)) : one.y))],
      box.current,
    );
    const observer = new ResizeObserver(() => box.current && plot.setSize({ width: box.current.clientWidth, height }));
    observer.observe(box.current);
    return () => {
      observer.disconnect();
      plot.destroy();
    };
  }, [key, theme, height]);
  return html`<figure class="chart">
    <figcaption>${title}</figcaption>
    <div ref=${box} role="img" aria-label=${inWords(title, x, series, marks)}></div>
  </figure>`;
}

function inWords(title, x, series, marks) {
  const lines = series
    .filter((one) => one.label)
    .map((one) => `${one.label}: ${one.y.filter((v) => v != null).length} values`);
  const told = marks.filter((one) => one.label).map((one) => one.label);
  return `${title}. ${lines.join("; ")}${told.length ? `. Marks: ${told.join(", ")}` : ""}`;
}

function optionsOf({
  series,
  xLabel,
  yLabel,
  time,
  log,
  marks,
  levels,
  height,
  yRange,
  xRange,
  legend,
  width,
  onPoint,
}) {
  const ink = colour("soft");
  const grid = { stroke: colour("faint"), width: 1 };
  const axis = {
    stroke: ink,
    grid,
    ticks: { stroke: colour("line"), width: 1 },
    font: "12px system-ui",
    labelFont: "12px system-ui",
    labelSize: 20,
  };
  const decades = log
    ? {
        splits: (u, axis, low, high) => powers(low, high),
        values: (u, splits) => splits.map((value) => `1e${Math.round(Math.log10(value))}`),
        filter: (u, splits) => splits,
      }
    : {};
  return {
    width,
    height,
    legend: { show: legend && series.filter((one) => one.label).length > 1, live: true },
    cursor: { drag: { x: true, y: false }, points: { size: 7 } },
    scales: { x: { time, range: xRange }, y: { distr: log ? 3 : 1, range: yRange } },
    axes: [
      { ...axis, label: xLabel, size: 36, ...(time ? { values: instants } : {}) },
      { ...axis, label: yLabel, size: 62, space: 26, ...decades },
    ],
    series: [{ label: time ? "at" : xLabel }, ...series.map((one) => seriesOf(one))],
    hooks: {
      drawClear: [(u) => drawMarks(u, marks, levels)],
      draw: [(u) => drawErrors(u, series)],
      ready: onPoint ? [(u) => watchClicks(u, onPoint)] : [],
    },
  };
}

const DAYS = new Intl.DateTimeFormat(undefined, { day: "numeric", month: "short" });
const HOURS = new Intl.DateTimeFormat(undefined, {
  day: "numeric",
  month: "short",
  hour: "2-digit",
  minute: "2-digit",
});

/** Days in words, with the hour where marks lie closer than days. */
function instants(u, splits, axis, space, step) {
  const words = step >= 86_400 ? DAYS : HOURS;
  return splits.map((at) => words.format(new Date(1000 * at)));
}

/** Whole powers of ten in a range, at most six. */
function powers(low, high) {
  const [first, last] = [Math.ceil(Math.log10(low)), Math.floor(Math.log10(high))];
  const step = Math.max(1, Math.ceil((last - first) / 5));
  return Array.from({ length: Math.max(0, Math.floor((last - first) / step) + 1) }, (_, k) => 10 ** (first + k * step));
}

function seriesOf({
  label = "",
  hue = "blue",
  line = true,
  shape = "disc",
  dash,
  points = true,
  width = 1.5,
  size = 6,
}) {
  const stroke = colour(hue);
  return {
    label,
    stroke,
    width: line ? width : 0,
    dash,
    spanGaps: false,
    paths: line ? undefined : () => null,
    points: { show: points ? (DRAWERS[shape] ?? true) : false, size, fill: stroke, stroke },
  };
}

function drawMarks(u, marks, levels) {
  const { ctx, bbox } = u;
  ctx.save();
  const rows = [];
  for (const mark of [...marks].sort((one, other) => one.x - other.x)) {
    const at = u.valToPos(mark.x, "x", true);
    if (at < bbox.left || at > bbox.left + bbox.width) continue;
    ctx.strokeStyle = ctx.fillStyle = colour(mark.hue ?? "vermillion");
    if (mark.width_x) band(u, mark);
    ctx.lineWidth = devicePixelRatio;
    ctx.setLineDash((mark.dash ?? []).map((one) => one * devicePixelRatio));
    line(ctx, at, bbox.top, at, bbox.top + bbox.height);
    if (mark.short) label(ctx, mark.short, at + 3, bbox, rows);
  }
  for (const level of levels) {
    const at = u.valToPos(level.y, "y", true);
    if (at < bbox.top || at > bbox.top + bbox.height) continue;
    ctx.strokeStyle = colour(level.hue ?? "grey");
    ctx.setLineDash((level.dash ?? [4, 4]).map((one) => one * devicePixelRatio));
    line(ctx, bbox.left, at, bbox.left + bbox.width, at);
  }
  ctx.restore();
}

/** A mark's word in the first row where it covers no other; `rows` says where each row is free from. */
function label(ctx, word, at, bbox, rows) {
  const free = rows.findIndex((end) => end < at);
  const row = free < 0 ? rows.length : free;
  rows[row] = at + ctx.measureText(word).width + 4;
  ctx.fillText(word, at, bbox.top + (10 + 12 * row) * devicePixelRatio);
}

function band(u, { x, width_x: half }) {
  const [low, high] = [u.valToPos(x - half, "x", true), u.valToPos(x + half, "x", true)];
  u.ctx.globalAlpha = 0.22;
  u.ctx.fillRect(low, u.bbox.top, high - low, u.bbox.height);
  u.ctx.globalAlpha = 1;
}

/** Upright bars of one standard deviation to either side. */
function drawErrors(u, series) {
  const { ctx, bbox } = u;
  ctx.save();
  ctx.beginPath();
  ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
  ctx.clip();
  series.forEach((one, index) => {
    if (!one.std || !u.series[index + 1].show) return;
    ctx.strokeStyle = colour(one.hue ?? "blue");
    ctx.lineWidth = devicePixelRatio;
    u.data[0].forEach((x, k) => {
      const [y, std] = [u.data[index + 1][k], one.std[k]];
      if (y == null || !(std > 0)) return;
      const at = u.valToPos(x, "x", true);
      line(ctx, at, u.valToPos(Math.max(y - std, SAFE), "y", true), at, u.valToPos(y + std, "y", true));
    });
  });
  ctx.restore();
}

function line(ctx, x0, y0, x1, y1) {
  ctx.beginPath();
  ctx.moveTo(x0, y0);
  ctx.lineTo(x1, y1);
  ctx.stroke();
}

/** A click tells which series and which place is nearest. */
function watchClicks(u, onPoint) {
  u.over.addEventListener("click", () => {
    const { idx, left, top } = u.cursor;
    if (idx == null) return;
    const near = u.series
      .map((one, k) => ({ k, value: k && one.show ? u.data[k][idx] : null }))
      .filter(({ value }) => value != null)
      .map(({ k, value }) => ({
        k,
        far: Math.hypot(u.valToPos(u.data[0][idx], "x") - left, u.valToPos(value, "y") - top),
      }))
      .sort((a, b) => a.far - b.far)[0];
    if (near && near.far < 24) onPoint(near.k - 1, idx);
  });
}
