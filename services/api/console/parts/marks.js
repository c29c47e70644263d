/**
 * Small marks: a state as symbol and word, progress as bar and number, the state of the live connection.
 */
import { html } from "../app/html.js";
import { SYMBOLS } from "../app/words.js";
import { percent } from "../app/format.js";

export function State({ of, word }) {
  return html`<span class=${`state ${of}`}><span aria-hidden="true">${SYMBOLS[of] ?? "•"}</span> ${word ?? of}</span>`;
}

/** A bar for `fraction` (0 to 1); `label` says of what. */
export function Bar({ fraction, label }) {
  return html`<progress value=${fraction} max="1" aria-label=${label}>${percent(fraction)}</progress>`;
}

/** All steps of a scan as one number. */
export function overall(progress) {
  const total = progress.reduce((sum, row) => sum + row.total, 0);
  return total ? progress.reduce((sum, row) => sum + row.fraction * row.total, 0) / total : 0;
}

const LIVE = { live: "live", lost: "connection lost; trying again", refused: "not live", connecting: "connecting" };

export function Live({ state }) {
  return html`<span class=${`live ${state}`} role="status"><span aria-hidden="true">●</span> ${LIVE[state]}</span>`;
}
