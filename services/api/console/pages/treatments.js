/**
 * Treatments side by side: f/f0 of the leading tracks of all their plants, day by day.
 */
import { html } from "../app/html.js";
import { get } from "../app/api.js";
import { percent } from "../app/format.js";
import { useLoad } from "../app/hooks.js";
import { Boxes } from "../parts/boxes.js";
import { Loaded } from "../parts/problem.js";

const MOST_DAYS = 24;

export function Treatments({ study, mine }) {
  const state = useLoad((signal) => get("/v1/fleet/treatments", { study }, signal), [study]);
  return html`<${Loaded} state=${state}>${({ items }) => html`
    <${Boxes} title="f/f₀ by treatment: median, quartiles and ends over the plants"
      groups=${items.map((one) => ({ name: one.treatment ?? "none", boxes: thinned(one.by_day) }))} />
    <div class="scroll"><table><thead><tr><th scope="col">Treatment</th><th scope="col" class="number">Plants</th><th
      scope="col" class="number">Lowest</th><th scope="col" class="number">Median</th><th scope="col"
      class="number">Highest</th></tr></thead>
      <tbody>${items.map(
        (
          one,
        ) => html`<tr aria-selected=${one.treatment === mine}><td>${one.treatment ?? "none"}</td><td class="number">
          ${one.plants}</td>
        <td class="number">${percent(one.latest?.min, 1)}</td><td class="number">${percent(one.latest?.median, 1)}</td>
          <td class="number">${percent(one.latest?.max, 1)}</td></tr>`,
      )}</tbody></table></div>`}
  <//>`;
}

/** At most so many days, evenly chosen, the last among them. */
function thinned(days) {
  const step = Math.ceil(days.length / MOST_DAYS);
  return days.filter((_, k) => (days.length - 1 - k) % step === 0).map(({ day, ...box }) => ({ at: day, ...box }));
}
