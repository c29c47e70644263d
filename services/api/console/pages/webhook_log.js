/**
 * What a webhook was told: every message with its attempts, opened line by line, and sent again.
 */
import { Fragment, html, useEffect, useState } from "../app/html.js";
import { get, post } from "../app/api.js";
import { ago, clock, counted, duration, moment } from "../app/format.js";
import { useLoad } from "../app/hooks.js";
import { to } from "../app/router.js";
import { useAct } from "../parts/act.js";
import { Choice } from "../parts/filters.js";
import { State } from "../parts/marks.js";
import { Pager } from "../parts/pager.js";
import { Loaded, ProblemBox } from "../parts/problem.js";
import { tell } from "../parts/told.js";
import { pick } from "./scans.js";

const WORDS = { waiting: "waiting", delivered: "delivered", given_up: "given up" };
const BUSY_MS = 1500; // while a message waits
const QUIET_MS = 10_000;
const COLUMNS = 6;

export function Deliveries({ hook, query, again }) {
  const asked = { ...pick(query, ["state", "cursor"]), limit: 50 };
  const path = `/v1/webhooks/${hook.id}/deliveries`;
  const state = useLoad((signal) => get(path, asked, signal), [hook.id, JSON.stringify(asked)], [again]);
  const waits = hook.enabled && Boolean(state.value?.items.some((one) => one.state === "waiting"));
  useEffect(() => {
    const timer = setInterval(() => document.hidden || state.reload(), waits ? BUSY_MS : QUIET_MS);
    return () => clearInterval(timer);
  }, [waits]);
  const options = Object.entries(WORDS).map(([value, text]) => ({ value, text }));
  return html`<div class="filters" role="search"><${Choice} label="State" name="state" query=${query}
      options=${options} /></div>
    <${Loaded} state=${state}>${(page) => html`
      ${
        page.items.length
          ? html`<${Table} path=${path} items=${page.items} onReplay=${state.reload} />`
          : html`<p class="wait">No messages here. They are kept for a month.</p>`
      }<${Pager} next=${page.next_cursor} />`}<//>`;
}

function Table({ path, items, onReplay }) {
  return html`<div class="scroll"><table class="deliveries">
    <caption class="hidden-label">${counted(items.length, "message")} on this page</caption>
    <thead><tr><th scope="col">Message</th><th scope="col">About</th><th scope="col">State</th><th scope="col"
      class="number aside">Attempts</th><th scope="col" class="aside">Made</th><th scope="col"><span class="hidden-label">Actions</span></th>
      </tr></thead>
    <tbody>${items.map((one) => html`<${Row} key=${one.id} path=${path} one=${one} onReplay=${onReplay} />`)}</tbody>
  </table></div>`;
}

function Row({ path, one, onReplay }) {
  const [open, setOpen] = useState(false);
  const act = useAct();
  const untried = one.state === "waiting" && one.attempts === 0;
  const replay = () =>
    act.run(async () => {
      await post(`${path}/${one.id}/replay`);
      tell("The message is sent again.");
      onReplay();
    });
  return html`<${Fragment}><tr data-delivery=${one.id}>
      <td><button class="plain" aria-expanded=${open} aria-controls=${`log-${one.id}`} onClick=${() => setOpen(!open)}>
        <span aria-hidden="true">${open ? "▾" : "▸"}</span> ${one.type}</button></td>
      <td><${About} data=${one.payload.data ?? {}} /></td>
      <td><${State} of=${one.state} word=${WORDS[one.state]} />${
        one.next_at && one.attempts > 0 && html`<br /><span class="small">next ${ago(one.next_at)}</span>`
      }</td>
      <td class="number aside">${one.attempts}</td>
      <td class="aside"><time datetime=${one.created_at} title=${moment(one.created_at)}>${ago(one.created_at)}</time></td>
      <td><button aria-label=${`Replay ${one.type} of ${moment(one.created_at)}`} onClick=${replay}
        disabled=${act.busy || untried}>Replay</button><${ProblemBox} problem=${act.problem} /></td>
    </tr>
    ${open && html`<tr id=${`log-${one.id}`} class="detail"><td colspan=${COLUMNS}><${Log} path=${path} one=${one} /></td></tr>`}<//>`;
}

/** The scan or alarm that a message tells of. */
function About({ data }) {
  if (data.scan) return html`<a href=${to(["scans", data.scan])}>${data.name || "scan"}</a>`;
  if (data.plant) return html`<a href=${to(["plants", data.plant])}>${data.plant}</a>`;
  return html`<span class="soft">–</span>`;
}

function Log({ path, one }) {
  const state = useLoad((signal) => get(`${path}/${one.id}`, {}, signal), [one.id], [one.attempts, one.state]);
  return html`<${Loaded} state=${state}>${({ log, payload, id }) => html`
    ${
      log.length
        ? html`<table class="attempts"><caption class="hidden-label">Attempts</caption>
      <thead><tr><th scope="col" class="number">Attempt</th><th scope="col">At</th><th scope="col"
        class="number">Took</th><th scope="col">Answer</th></tr></thead>
      <tbody>${log.map(
        (attempt) => html`<tr key=${attempt.number}><td class="number">${attempt.number}</td>
        <td><time datetime=${attempt.at} title=${moment(attempt.at)}>${clock(attempt.at)}</time></td>
        <td class="number">${duration(attempt.took_s)}</td><td><${Answer} attempt=${attempt} /></td></tr>`,
      )}</tbody></table>`
        : html`<p class="soft">It was not tried yet.</p>`
    }
    <p class="small">Message <code>${id}</code>, made ${moment(one.created_at)}</p>
    <pre class="log">${JSON.stringify(payload, null, 2)}</pre>`}<//>`;
}

function Answer({ attempt }) {
  const good = attempt.status >= 200 && attempt.status < 300;
  const word = attempt.status === null ? attempt.error : `${attempt.status}`;
  return html`<${State} of=${good ? "succeeded" : "failed"} word=${word} />${
    attempt.answer && html` <span class="small">${attempt.answer}</span>`
  }`;
}
