/**
 * A history as a small line: [[seconds, value], …], with the level 1 where values are ratios.
 */
import { html } from "../app/html.js";

const [WIDTH, HEIGHT, EDGE] = [108, 30, 3];

export function Spark({ points, level = 1, label }) {
  if (!points || points.length < 2) return html`<span class="soft">–</span>`;
  const [times, values] = [points.map(([at]) => at), points.map(([, value]) => value)];
  const low = Math.min(level, ...values);
  const high = Math.max(level, ...values);
  const x = (at) => EDGE + ((at - times[0]) / (times.at(-1) - times[0] || 1)) * (WIDTH - 2 * EDGE);
  const y = (value) => HEIGHT - EDGE - ((value - low) / (high - low || 1)) * (HEIGHT - 2 * EDGE);
  const path = points.map(([at, value], k) => `${k ? "L" : "M"}${x(at).toFixed(1)} ${y(value).toFixed(1)}`).join("");
  return html`<svg class="spark" viewBox=${`0 0 ${WIDTH} ${HEIGHT}`} role="img" aria-label=${label}>
    <line x1="0" x2=${WIDTH} y1=${y(level)} y2=${y(level)} /><path d=${path} />
    <circle cx=${x(times.at(-1))} cy=${y(values.at(-1))} r="2.4" />
  </svg>`;
}
