/**
 * What can be done with a scan: cancel, run again, fork with changes, forget. What destroys asks first.
 */
import { html, useState } from "../app/html.js";
import { post, remove } from "../app/api.js";
import { go, to } from "../app/router.js";
import { KINDS, stepName } from "../app/words.js";
import { Confirm, Dialog } from "../parts/dialog.js";
import { ProblemBox } from "../parts/problem.js";
import { tell } from "../parts/told.js";

const ENDED = ["succeeded", "failed", "canceled"];

export function Actions({ scan, onChange }) {
  const [asking, setAsking] = useState("");
  const [problem, setProblem] = useState(null);
  const close = () => setAsking("");
  const ended = ENDED.includes(scan.status);
  const act = (path, said) => async () => {
    await post(`/v1/scans/${scan.id}/${path}`);
    tell(said);
    onChange();
  };
  const now = (path, said) => () => act(path, said)().then(() => setProblem(null), setProblem);
  return html`
    <div class="buttons">
      ${!ended && scan.state !== "paused" && html`<button
        onClick=${now("pause", "No more steps are begun; what computes goes on.")}>Pause</button>`}
      ${scan.state === "paused" && html`<button class="main"
        onClick=${now("resume", "The scan goes on.")}>Resume</button>`}
      ${!ended && html`<button class="danger" onClick=${() => setAsking("cancel")}>Cancel</button>`}
      ${ended && scan.status !== "succeeded" && html`<button class="main"
        onClick=${now("retry", "What had not succeeded runs again.")}>Retry what failed</button>`}
      ${ended && html`<button onClick=${() => setAsking("retry")}>Run again from a step …</button>`}
      <button onClick=${() => go(to(["new"], { fork: scan.id }))}>Fork with changes …</button>
      ${ended && html`<button class="danger" onClick=${() => setAsking("delete")}>Delete</button>`}
    </div>
    <${ProblemBox} problem=${problem} />
    <${Confirm} open=${asking === "cancel"} title="Cancel this scan?" yes="Cancel the scan" danger onClose=${close}
      text="What waits is canceled at once, what computes stops within seconds. Finished steps are kept: the scan can be run again."
      work=${act("cancel", "The scan is being canceled.")} />
    <${Confirm} open=${asking === "delete"} title="Delete this scan?" yes="Delete it" danger onClose=${close}
      text="The scan and its files are gone for good. Forks of it keep theirs."
      work=${async () => {
        await remove(`/v1/scans/${scan.id}`);
        tell("The scan is deleted.");
        go(to(["scans"]));
      }} />
    <${RetryFrom} open=${asking === "retry"} scan=${scan} act=${act} onClose=${close} />
  `;
}

function RetryFrom({ open, scan, act, onClose }) {
  const kinds = KINDS.filter((kind) => scan.progress.some((row) => row.step === kind));
  const [from, setFrom] = useState(kinds.at(-1) ?? KINDS.at(-1));
  const [problem, setProblem] = useState(null);
  const run = () => act(`retry?from=${from}`, "The scan runs again.")().then(onClose, setProblem);
  return html`<${Dialog} open=${open} title="Run again from a step" onClose=${onClose}>
    <p>This kind of step and all after it are computed afresh; what they made before is replaced.</p>
    <label>From <select value=${from} onChange=${(event) => setFrom(event.target.value)}>
      ${kinds.map((kind) => html`<option value=${kind} selected=${kind === from}>${stepName(kind)}</option>`)}
    </select></label>
    <${ProblemBox} problem=${problem} />
    <div class="buttons"><button onClick=${onClose}>No, go back</button><button class="main"
      onClick=${run}>Run again</button></div>
  <//>`;
}
