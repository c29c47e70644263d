/**
 * Tracks in a table, and what can be put right by hand: names, joined and split tracks, modes moved, doubts confirmed.
 */
import { html, useState } from "../app/html.js";
import { patch } from "../app/api.js";
import { day, measured, moment, number, percent } from "../app/format.js";
import { requery, to } from "../app/router.js";
import { State } from "../parts/marks.js";
import { ProblemBox } from "../parts/problem.js";
import { tell } from "../parts/told.js";

export function Tracks({ story, query, onChange }) {
  const [problem, setProblem] = useState(null);
  const chosen = story.tracks.find((one) => one.id === query.get("track"));
  const correct = async (track, change, said) => {
    try {
      await patch(`/v1/tracks/${track.id}`, change);
      setProblem(null);
      tell(said);
      onChange();
    } catch (error) {
      setProblem(error);
    }
  };
  if (!story.tracks.length) return html`<p class="wait">There are no tracks yet.</p>`;
  return html`
    <${ProblemBox} problem=${problem} />
    <div class="scroll"><table>
      <thead><tr><th scope="col">Track</th><th scope="col">State</th><th scope="col" class="number">Frequency (Hz)</th>
        <th scope="col" class="number">f₀ (Hz)</th>
        <th scope="col" class="number">f/f₀</th><th scope="col" class="number">Scans</th><th scope="col"
          class="number">Missed</th><th scope="col" class="number">Doubtful</th><th scope="col">Seen</th></tr></thead>
      <tbody>${story.tracks.map(
        (one) => html`<tr key=${one.id} aria-selected=${one === chosen}>
        <td><button class="plain" aria-pressed=${one === chosen}
          onClick=${() => requery({ track: one === chosen ? "" : one.id })}>${one.name}</button>
          ${one.by_hand ? html` <span class="tag">by hand</span>` : ""}</td>
        <td><${State} of=${one.state === "active" ? "running" : "closed"} word=${one.state} /></td>
        <td class="number">${measured(one.frequency_hz, one.frequency_std_hz)}</td><td class="number">
          ${measured(one.reference_hz, one.reference_std_hz)}</td>
        <td class="number">${one.ratio == null ? "–" : percent(one.ratio, 1)}</td><td class="number">${one.scans}</td>
          <td class="number">${one.missed}</td><td class="number">${one.doubtful_links || ""}</td>
        <td>${day(one.born_at)} to ${day(one.last_seen_at)}</td></tr>`,
      )}</tbody>
    </table></div>
    ${chosen && html`<${Correct} key=${chosen.id} track=${chosen} others=${story.tracks.filter((one) => one !== chosen)}
      correct=${correct} />`}`;
}

function Correct({ track, others, correct }) {
  const [name, setName] = useState(track.name);
  const [into, setInto] = useState("");
  const rename = (event) => {
    event.preventDefault();
    correct(track, { name }, "The track is renamed.");
  };
  return html`<section class="card" aria-label=${`Correct ${track.name}`}>
    <h2>Correct ${track.name}</h2>
    <form class="filters" onSubmit=${rename}><label>Name <input name="track-name" value=${name} maxlength="64"
      onInput=${(event) => setName(event.target.value)} /></label><button>Rename</button>
      <label>The same as <select name="merge" value=${into} onChange=${(event) => setInto(event.target.value)}><option
        value="">choose a track</option>${others.map((one) => html`<option value=${one.id}>${one.name}</option>`)}
        </select></label>
      <button type="button" disabled=${!into}
        onClick=${() => correct(track, { merge_into: into }, "The tracks are one.")}>Join</button>
      ${track.by_hand && html`<button type="button"
        onClick=${() => correct(track, { release: true }, "What was done by hand is forgotten.")}>Forget what was done by hand</button>`}
    </form>
    <div class="scroll files"><table>
      <thead><tr><th scope="col">Scan</th><th scope="col" class="number">Frequency (Hz)</th><th scope="col"
        class="number">MAC</th><th scope="col">Link</th><th scope="col">Put right</th></tr></thead>
      <tbody>${track.points.scan
        .map((scan, k) => ({ scan, k }))
        .reverse()
        .map(
          ({ scan, k }) =>
            html`<${Link} key=${scan} track=${track} scan=${scan} k=${k} others=${others} correct=${correct} />`,
        )}</tbody>
    </table></div></section>`;
}

const LINKS = { born: "none", sure: "accepted", doubtful: "doubtful", manual: "acknowledged" };

function Link({ track, scan, k, others, correct }) {
  const { points } = track;
  const where = { scan, organ: track.organ, mode: points.mode[k] };
  const move = (event) => {
    const to = { "": undefined, none: null }[event.target.value];
    correct(track, { move: { ...where, to: to === undefined ? event.target.value : to } }, "The mode is moved.");
  };
  return html`<tr>
    <td><a href=${to(["scans", scan])}>${moment(points.at[k])}</a></td>
    <td class="number">${measured(points.frequency_hz[k], points.frequency_std_hz[k])}</td>
    <td class="number">${number(points.mac[k], 3)}</td>
    <td><${State} of=${LINKS[points.link[k]] ?? "none"} word=${points.link[k]} /></td>
    <td>${points.link[k] === "doubtful" && html`<button
      onClick=${() => correct(track, { confirm: { scan } }, "The link is confirmed.")}>It is right</button> `}
      ${k > 0 && html`<button onClick=${() => correct(track, { split_at: { scan } }, "The track is split.")}>Another mode from here</button> `}
      <label class="hidden-label" for=${`move-${scan}`}>Move this mode</label>
      <select id=${`move-${scan}`} onChange=${move}><option value="" selected>move to …</option><option
        value="new">a new track</option><option value="none">no track</option>
        ${others.map((one) => html`<option value=${one.id}>${one.name}</option>`)}</select></td></tr>`;
}
