/**
 * Pages of a list behind cursors: on by the cursor of the answer, back through the history.
 */
import { html } from "../app/html.js";
import { place, requery } from "../app/router.js";

export function Pager({ next }) {
  const cursor = place().query.get("cursor") ?? "";
  const trail = (place().query.get("trail") ?? "").split("~").filter(Boolean);
  if (!next && !cursor) return null;
  const forward = () => requery({ cursor: next, trail: [...trail, cursor || "-"].join("~") });
  const back = () => {
    const before = trail.at(-1) ?? "-";
    requery({ cursor: before === "-" ? "" : before, trail: trail.slice(0, -1).join("~") });
  };
  return html`<nav class="pager" aria-label="Pages of the list">
    <button disabled=${!cursor} onClick=${back}>← Back</button>
    <button disabled=${!next} onClick=${forward}>Further →</button>
  </nav>`;
}
