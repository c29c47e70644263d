/**
 * Box plots side by side over time: median, quartiles, whiskers to the ends. Groups differ in hue, in how full their boxes
 * are, and in their place from left to right.
 */
import { html } from "../app/html.js";
import { HUES } from "./chart.js";

const [WIDTH, HEIGHT, LEFT, BOTTOM, TOP] = [960, 300, 52, 34, 8];
const MOST_LABELS = 9;

/** `groups`: [{name, boxes: [{at: "2026-01-03", n, min, q1, median, q3, max}]}]; values are shown in per cent. */
export function Boxes({ groups, title }) {
  const days = [...new Set(groups.flatMap((one) => one.boxes.map((box) => box.at)))].sort();
  const values = groups.flatMap((one) => one.boxes.flatMap((box) => [box.min, box.max]));
  if (!values.length) return html`<p class="wait">There is nothing to compare yet.</p>`;
  const [low, high] = [Math.min(...values), Math.max(...values)];
  const y = (value) => TOP + (1 - (value - low) / (high - low || 1)) * (HEIGHT - TOP - BOTTOM);
  const step = (WIDTH - LEFT) / days.length;
  const wide = Math.min(26, (0.8 * step) / groups.length);
  const x = (day, k) => LEFT + (days.indexOf(day) + 0.5) * step + (k - (groups.length - 1) / 2) * wide;
  return html`<figure>
    <figcaption class="small">${title}</figcaption>
    <div class="legend">${groups.map((one, k) => html`<span><span class=${`swatch ${lookOf(k)}`}></span>${one.name}
      </span>`)}</div>
    <svg class="boxes" viewBox=${`0 0 ${WIDTH} ${HEIGHT}`} role="img" aria-label=${inWords(title, groups)}>
      ${ticks(low, high).map((value) => html`<g><line
        class="axis" x1=${LEFT} x2=${WIDTH} y1=${y(value)} y2=${y(value)} /><text x=${LEFT - 6} y=${y(value) + 4}
        text-anchor="end">${(100 * value).toFixed(1)} %</text></g>`)}
      ${days.filter((_, k) => k % Math.ceil(days.length / MOST_LABELS) === 0).map((day) => html`<text
        x=${LEFT + (days.indexOf(day) + 0.5) * step} y=${HEIGHT - 12} text-anchor="middle">${day.slice(5)}</text>`)}
      ${groups.map((one, k) => one.boxes.map((box) => html`<${Box} box=${box} x=${x(box.at, k)} y=${y}
        wide=${wide * 0.8} look=${lookOf(k)} name=${one.name} />`))}
    </svg></figure>`;
}

const lookOf = (k) => `box-${HUES[k % HUES.length]} fill-${k % 4}`;

function Box({ box, x, y, wide, look, name }) {
  const half = wide / 2;
  return html`<g class=${look}><title>${`${name}, ${box.at}: median ${(100 * box.median).toFixed(1)} %, n = ${box.n}`}
    </title>
    <line x1=${x} x2=${x} y1=${y(box.min)} y2=${y(box.max)} />
    <rect x=${x - half} width=${wide} y=${y(box.q3)} height=${Math.max(1, y(box.q1) - y(box.q3))} />
    <line class="median" x1=${x - half} x2=${x + half} y1=${y(box.median)} y2=${y(box.median)} /></g>`;
}

function ticks(low, high) {
  const rough = (high - low || 0.01) / 5;
  const size = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map((one) => one * size).find((one) => one >= rough);
  const first = Math.ceil(low / step);
  return Array.from({ length: Math.max(1, Math.floor(high / step) - first + 1) }, (_, k) => (first + k) * step);
}

const inWords = (title, groups) =>
  `${title}. ${groups.map((one) => (one.boxes.length ? `${one.name}: median ${(100 * one.boxes.at(-1).median).toFixed(1)} % at the end` : one.name)).join("; ")}`;
