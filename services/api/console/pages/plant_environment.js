/**
 * Environment columns over the same weeks, and events: looked at, and written down by hand.
 */
import { html, useState } from "../app/html.js";
import { post, send } from "../app/api.js";
import { labelOf } from "../form/schema.js";
import { Chart, HUES } from "../parts/chart.js";
import { ProblemBox } from "../parts/problem.js";
import { tell } from "../parts/told.js";
import { marksOf, seconds } from "./plant_history.js";

const KINDS = ["watering", "treatment", "note", "repotting", "pruning", "harvest", "other"];
const FEW = 120; // points; beyond them a line alone
const UNITS = {
  temperature_c: "Temperature (°C)",
  humidity_percent: "Humidity (%)",
  light_umol_m2_s: "Light (µmol/m²/s)",
  soil_water_percent: "Soil water (%)",
  mass_g: "Mass (g)",
};

export function Environment({ story, path, onChange }) {
  const { environment } = story;
  const marks = marksOf({ events: story.events, alarms: [] });
  const x = environment.at.map(seconds);
  return html`
    ${environment.columns.length === 0 && html`<p class="wait">Nothing of the environment was sent yet.</p>`}
    <div class="two">${environment.columns.map((column, k) => html`<${Column} key=${column} name=${column}
      hue=${HUES[k % HUES.length]} x=${x} values=${environment.values[column]} marks=${marks} />`)}</div>
    <${NewEvent} path=${path} onChange=${onChange} />
    <${Records} path=${path} onChange=${onChange} />`;
}

/** One column where it was measured: columns have instants of their own. */
function Column({ name, hue, x, values, marks }) {
  const known = values.map((value, k) => k).filter((k) => values[k] !== null);
  return html`<${Chart} title=${UNITS[name] ?? labelOf(name)} x=${known.map((k) => x[k])} time xLabel=""
    yLabel=${UNITS[name] ?? name}
    height=${180} marks=${marks}
      series=${[{ label: name, y: known.map((k) => values[k]), hue, points: known.length < FEW, size: 4 }]} />`;
}

function NewEvent({ path, onChange }) {
  const [problem, setProblem] = useState(null);
  const onSubmit = async (event) => {
    event.preventDefault();
    const form = event.target;
    const said = Object.fromEntries(new FormData(form));
    const body = { kind: said.kind, note: said.note };
    if (said.at) body.at = new Date(said.at).toISOString();
    if (said.amount) Object.assign(body, { amount: Number(said.amount), unit: said.unit || "ml" });
    try {
      await post(`${path}/events`, body);
      setProblem(null);
      form.reset();
      tell("The event is written down.");
      onChange();
    } catch (error) {
      setProblem(error);
    }
  };
  return html`<h2>Write an event down</h2><form class="filters" onSubmit=${onSubmit}>
    <label>What <select name="kind">${KINDS.map((kind) => html`<option>${kind}</option>`)}</select></label>
    <label>When <input type="datetime-local" name="at" /></label>
    <label>How much <input type="number" step="any" min="0" name="amount" /></label><label>Unit <input name="unit"
      placeholder="ml" maxlength="16" /></label>
    <label>Note <input name="note" maxlength="500" /></label><button>Write down</button></form><${ProblemBox}
      problem=${problem} />`;
}

function Records({ path, onChange }) {
  const [problem, setProblem] = useState(null);
  const onFile = async (event) => {
    try {
      const text = await event.target.files[0].text();
      const answer = await sendText(`${path}/environment`, text);
      setProblem(null);
      tell(`${answer.stored} records are stored.`);
      onChange();
    } catch (error) {
      setProblem(error);
    }
  };
  return html`<h2>Add measurements</h2><p
    class="small">A CSV file with a header: <code>at,temperature_c,humidity_percent,light_umol_m2_s,soil_water_percent,mass_g</code> and any other column of numbers.</p>
    <label class="button">CSV file <input type="file" accept=".csv,text/csv" onChange=${onFile} /></label><${ProblemBox}
      problem=${problem} />`;
}

async function sendText(path, text) {
  return (await send(path, { method: "POST", headers: { "Content-Type": "text/csv" }, raw: text })).json();
}
