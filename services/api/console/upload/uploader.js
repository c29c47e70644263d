/**
 * Where files are dropped: progress of each, some at a time; when all are there they become a capture.
 */
import { html, useEffect, useRef, useState } from "../app/html.js";
import { get, post } from "../app/api.js";
import { bytes, counted, percent } from "../app/format.js";
import { Bar } from "../parts/marks.js";
import { ProblemBox } from "../parts/problem.js";
import { namesIn } from "../space/npz.js";
import { filesOf } from "./drop.js";
import { begun, forget, nameOf, upload } from "./tus.js";

const AT_ONCE = 3;
const CLOUDS = /\.(ply|npz)$/i;
const HIDDEN = /(^|\/)\.|Thumbs\.db$/;

/** `onCapture({source, facts, …})` once the capture is made. */
export function Uploader({ onCapture }) {
  const [rows, setRows] = useState([]);
  const [problem, setProblem] = useState(null);
  const [over, setOver] = useState(false);
  const [waiting, setWaiting] = useState([]);
  const [making, setMaking] = useState(false);
  const abort = useRef(new AbortController());
  useEffect(() => {
    get("/v1/uploads", { limit: 200 }).then(
      (page) => setWaiting(page.items.filter((one) => !one.complete)),
      () => {},
    );
    return () => abort.current.abort();
  }, []);
  const change = (file, changes) =>
    setRows((old) => old.map((row) => (row.file === file ? { ...row, ...changes } : row)));

  async function take(files) {
    const kept = files.filter((file) => !HIDDEN.test(nameOf(file) || file.name));
    if (!kept.length) return;
    setProblem(null);
    setWaiting([]);
    setRows(kept.map((file) => ({ file, sent: 0, state: begun(file) ? "going on" : "waiting", id: null })));
    try {
      const ids = await sendAll(kept, change, abort.current.signal);
      setMaking(true);
      const capture = await assemble(kept, ids);
      forget(kept);
      onCapture(capture);
    } catch (error) {
      if (error.name !== "AbortError") setProblem(error);
    } finally {
      setMaking(false);
    }
  }

  const onDrop = async (event) => {
    event.preventDefault();
    setOver(false);
    take(await filesOf(event.dataTransfer));
  };
  return html`
    <div class=${over ? "drop over" : "drop"} onDragOver=${(event) => (event.preventDefault(), setOver(true))}
      onDragLeave=${() => setOver(false)} onDrop=${onDrop}>
      <p><strong>Drop pictures, videos, point clouds or one zip file here</strong>, or a folder of them.</p>
      <div class="buttons centered">
        <label class="button">Choose files <input type="file" name="files" multiple
          onChange=${(event) => take([...event.target.files])} /></label>
        <label class="button">Choose a folder <input type="file" name="folder" webkitdirectory
          onChange=${(event) => take([...event.target.files])} /></label>
      </div>
      ${
        waiting.length > 0 &&
        html`<p class="small" role="status">${counted(waiting.length, "upload")} not finished (${waiting
          .slice(0, 3)
          .map((one) => `${one.name} ${percent(one.received / Math.max(1, one.length))}`)
          .join(", ")}${waiting.length > 3 ? " …" : ""}):
        drop the same files again and they go on where they stood.</p>`
      }
    </div>
    <${ProblemBox} problem=${problem} onRetry=${() => take(rows.map((row) => row.file))} />
    ${rows.length > 0 && html`<${Progress} rows=${rows} making=${making} />`}
  `;
}

function Progress({ rows, making }) {
  const size = rows.reduce((sum, row) => sum + row.file.size, 0);
  const sent = rows.reduce((sum, row) => sum + row.sent, 0);
  return html`<div class="card" aria-label="Uploads">
    <p><${Bar} fraction=${size ? sent / size : 1} label="Progress of all files" /> <span class="small" role="status">
      ${making ? "Looking at the files …" : `${bytes(sent)} of ${bytes(size)}, ${counted(rows.length, "file")}`}</span>
        </p>
    <div class="files scroll"><table><tbody>${rows.slice(0, 500).map(
      (row) => html`<tr key=${nameOf(row.file) || row.file.name}>
      <td>${nameOf(row.file) || row.file.name}</td><td class="number">${bytes(row.file.size)}</td>
      <td><${Bar} fraction=${row.file.size ? row.sent / row.file.size : 1} label=${`Progress of ${row.file.name}`} />
        </td><td>${row.state}</td></tr>`,
    )}</tbody></table></div>
  </div>`;
}

/** Ids of the uploads, in the order of the files; some go at a time. */
async function sendAll(files, change, signal) {
  const ids = new Array(files.length);
  let next = 0;
  const worker = async () => {
    while (next < files.length) {
      const k = next++;
      const file = files[k];
      change(file, { state: "sending" });
      ids[k] = await upload(file, { signal, onProgress: (sent) => change(file, { sent }) });
      change(file, { state: "there", sent: file.size });
    }
  };
  await Promise.all(Array.from({ length: Math.min(AT_ONCE, files.length) }, worker));
  return ids;
}

async function assemble(files, ids) {
  const isArchive = files.length === 1 && /\.zip$/i.test(files[0].name);
  const names = isArchive ? await namesIn(files[0]).catch(() => []) : files.map((file) => file.name);
  const kind = names.some((name) => CLOUDS.test(name)) ? "clouds" : "capture";
  if (isArchive) return post("/v1/captures", { archive: ids[0], kind });
  return post("/v1/captures", {
    kind,
    files: files.map((file, k) => ({ upload: ids[k], name: withoutFolder(nameOf(file) || file.name, files) })),
  });
}

/** The path without the folder that all files share: the capture is the folder. */
function withoutFolder(name, files) {
  const top = name.split("/")[0];
  const shared = name.includes("/") && files.every((file) => (nameOf(file) || file.name).startsWith(`${top}/`));
  return shared ? name.slice(top.length + 1) : name;
}
