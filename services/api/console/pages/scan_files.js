/**
 * A scan's files: results first, each to be saved; the report opens in the page's own address where no key is needed.
 */
import { html, useState } from "../app/html.js";
import { apiKey, download, get } from "../app/api.js";
import { bytes, counted } from "../app/format.js";
import { useLoad } from "../app/hooks.js";
import { Loaded, ProblemBox } from "../parts/problem.js";

const SHOWN = 200;
const WHAT = {
  "modes.json": "every mode with its numbers and verdict",
  "modes.csv": "the same as a table",
  "modes.parquet": "the same for programs",
  "modes.uff": "universal file for modal software",
  "report.html": "the report: one file, prints well",
  "result.npz": "every array of the result",
  "displacement.zarr.zip": "displacement of every sensor in every frame",
  "truth.npz": "what the simulation imposed",
  "manifest.json": "digests, sizes and units of the files",
  "spec.json": "what was asked for",
};

export function Files({ scan, ticks }) {
  const state = useLoad((signal) => get(`/v1/scans/${scan.id}/artifacts`, {}, signal), [scan.id], [ticks]);
  const [text, setText] = useState("");
  const [problem, setProblem] = useState(null);
  const save = (name) => download(fileAddress(scan.id, name), name.split("/").at(-1)).catch(setProblem);
  return html`<${ProblemBox} problem=${problem} /><${Loaded} state=${state}>${({ items }) => {
    const found = items.filter((file) => file.name.includes(text));
    return html`
      ${items.some((file) => file.name === "report.html") && !apiKey() && html`<p><a
        href=${fileAddress(scan.id, "report.html")} target="_blank" rel="noopener">Open the report</a></p>`}
      <div class="filters"><label>Name <input type="search" value=${text}
        onInput=${(event) => setText(event.target.value)} /></label>
        <span class="small">${counted(found.length, "file")}, ${bytes(found.reduce((sum, file) => sum + file.size, 0))}
          </span></div>
      <div class="scroll"><table>
        <thead><tr><th scope="col">File</th><th scope="col">What</th><th scope="col" class="number">Size</th></tr>
          </thead>
        <tbody>${found.slice(0, SHOWN).map(
          (file) => html`<tr key=${file.name}>
          <td><button class="plain" onClick=${() => save(file.name)}>${file.name}</button></td>
          <td class="soft">${WHAT[file.name] ?? file.media_type}</td><td class="number">${bytes(file.size)}</td></tr>`,
        )}</tbody>
      </table></div>
      ${found.length > SHOWN && html`<p class="small">The first ${SHOWN} of ${found.length}.</p>`}`;
  }}<//>`;
}

export const fileAddress = (id, name) =>
  `/v1/scans/${id}/artifacts/${name.split("/").map(encodeURIComponent).join("/")}`;
