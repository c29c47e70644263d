/**
 * Tracks over weeks: frequency, damping or shape correlation with error bars; events and alarms as upright marks.
 */
import { html, useMemo, useState } from "../app/html.js";
import { counted, day, moment } from "../app/format.js";
import { go, to } from "../app/router.js";
import { Chart, HUES, SHAPES } from "../parts/chart.js";

const PERCENT = 100;
const VIEWS = {
  ratio: { label: "f/f₀", unit: "f/f₀ (%)", value: "ratio", std: "ratio_std", scale: PERCENT },
  compensated: {
    label: "f/f₀ without what the environment explains",
    unit: "f/f₀ (%)",
    value: "compensated_ratio",
    std: "ratio_std",
    scale: PERCENT,
  },
  frequency: { label: "Frequency", unit: "Hz", value: "frequency_hz", std: "frequency_std_hz", scale: 1 },
  damping: { label: "Damping", unit: "%", value: "damping_ratio", std: "damping_ratio_std", scale: PERCENT },
  mac: { label: "Shape correlation", unit: "MAC with the track's shape before", value: "mac", std: null, scale: 1 },
  amplitude: { label: "Amplitude", unit: "mm", value: "amplitude_m", std: null, scale: 1000 },
};
const HEIGHT = 380;

export const seconds = (text) => new Date(text).getTime() / 1000;

export function History({ story }) {
  const [view, setView] = useState("ratio");
  const [hidden, setHidden] = useState([]);
  const tracks = story.tracks;
  const shown = tracks.filter((one) => !hidden.includes(one.id));
  const { x, series } = useMemo(() => joined(shown, VIEWS[view], tracks), [story, view, hidden]);
  if (!tracks.length)
    return html`<p class="wait">No modes were followed yet: tracks begin with the first scan that has modes.</p>`;
  const toggle = (id) => setHidden((old) => (old.includes(id) ? old.filter((one) => one !== id) : [...old, id]));
  const onPoint = (k, index) => {
    const scan = scanAt(shown[k], x[index]);
    if (scan) go(to(["scans", scan]));
  };
  return html`
    <div class="controls"><label>Show <select name="view" value=${view}
      onChange=${(event) => setView(event.target.value)}>
      ${Object.entries(VIEWS).map(([key, one]) => html`<option value=${key} selected=${key === view}>${one.label}
        </option>`)}</select></label>
      ${tracks.map(
        (
          one,
          k,
        ) => html`<label class="row" key=${one.id}><input type="checkbox" checked=${!hidden.includes(one.id)}
          onChange=${() => toggle(one.id)} />
        <span class="swatch" aria-hidden="true" data-hue=${HUES[k % HUES.length]}>${GLYPHS[SHAPES[k % SHAPES.length]]}
          </span> ${one.name}</label>`,
      )}
    </div>
    <${Chart} title=${`${VIEWS[view].label} of ${counted(shown.length, "track")}, bars are one standard deviation; a point opens its scan`} time
      x=${x} xLabel="" yLabel=${VIEWS[view].unit} series=${series} height=${HEIGHT} marks=${marksOf(story)}
        onPoint=${onPoint}
      levels=${["ratio", "compensated"].includes(view) ? [{ y: PERCENT, hue: "grey" }] : []} />
    <${Events} story=${story} />`;
}

const GLYPHS = { disc: "●", square: "■", diamond: "◆", triangle: "▲", cross: "✕", ring: "○" };

/** The columns of several tracks on one axis of time. */
export function joined(tracks, view, all = tracks) {
  const x = [...new Set(tracks.flatMap((one) => one.points.at.map(seconds)))].sort((a, b) => a - b);
  const place = new Map(x.map((at, k) => [at, k]));
  const series = tracks.map((one) => {
    const [y, std] = [new Array(x.length).fill(null), new Array(x.length).fill(null)];
    one.points.at.forEach((at, k) => {
      const value = one.points[view.value]?.[k];
      y[place.get(seconds(at))] = value == null ? null : value * view.scale;
      if (view.std) std[place.get(seconds(at))] = (one.points[view.std]?.[k] ?? 0) * view.scale;
    });
    const k = all.indexOf(one);
    return {
      label: one.name,
      y,
      std: view.std ? std : null,
      hue: HUES[k % HUES.length],
      shape: SHAPES[k % SHAPES.length],
      size: 6,
      width: 1,
    };
  });
  return { x, series };
}

const scanAt = (track, at) => track?.points.scan[track.points.at.findIndex((one) => seconds(one) === at)];

/** Events, and since when each alarm says that something has changed. */
export function marksOf(story) {
  const events = story.events.map((one) => ({
    x: seconds(one.at),
    label: `${one.kind} ${day(one.at)}`,
    hue: "blue",
    dash: [2, 4],
    short: one.kind,
  }));
  const alarms = story.alarms
    .filter((one) => one.since)
    .map((one) => ({
      x: seconds(one.since),
      label: `${one.title}`,
      hue: "vermillion",
      dash: one.state === "closed" ? [2, 4] : [],
      short: "change",
    }));
  return [...events, ...alarms];
}

function Events({ story }) {
  if (!story.events.length) return null;
  return html`<details><summary>${counted(story.events.length, "event")}</summary><ul>${story.events.map(
    (one) => html`<li>${moment(one.at)}: ${one.kind}
    ${one.amount != null ? ` ${one.amount} ${one.unit ?? ""}` : ""} ${one.note}</li>`,
  )}</ul></details>`;
}
