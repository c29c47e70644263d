/**
 * What the steps wrote, oldest first; what comes is added while the page is open.
 */
import { html, useEffect, useRef, useState } from "../app/html.js";
import { get } from "../app/api.js";
import { clock } from "../app/format.js";
import { stepName } from "../app/words.js";
import { ProblemBox } from "../parts/problem.js";

const MOST_LINES = 5000;
const NEAR_END_PX = 40;

export function Logs({ scan, ticks }) {
  const [lines, setLines] = useState([]);
  const [problem, setProblem] = useState(null);
  const after = useRef(0);
  const busy = useRef(false);
  const box = useRef(null);
  useEffect(() => {
    if (busy.current) return;
    busy.current = true;
    fetchFurther(scan.id, after)
      .then((more) => more.length && setLines((old) => [...old, ...more].slice(-MOST_LINES)), setProblem)
      .finally(() => (busy.current = false));
  }, [scan.id, ticks, scan.progress]);
  useEffect(() => {
    const log = box.current;
    if (log && log.scrollHeight - log.scrollTop - log.clientHeight < NEAR_END_PX + 20 * 22)
      log.scrollTop = log.scrollHeight;
  }, [lines]);
  return html`
    <${ProblemBox} problem=${problem} />
    ${
      lines.length === 0
        ? html`<p class="wait">${scan.finished_at ? "The steps wrote nothing: all went as it should." : "Nothing was written yet."}</p>`
        : html`<pre class="log" ref=${box} tabindex="0" role="log" aria-label="What the steps wrote">${lines.map(
            (line) => html`
          <div key=${line.id}><span class="at">
            ${clock(line.at)} ${stepName(line.step)}${line.frame >= 0 ? ` ${line.frame}` : ""}</span> <span
            class=${line.level}>${line.text}</span></div>`,
          )}</pre>`
    }
  `;
}

async function fetchFurther(id, after) {
  const found = [];
  for (;;) {
    const page = await get(`/v1/scans/${id}/logs`, { after: after.current, limit: 1000 });
    after.current = page.after;
    found.push(...page.items);
    if (page.items.length < 1000) return found;
  }
}
