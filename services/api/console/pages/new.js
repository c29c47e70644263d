/**
 * A new scan: a preset, files, or another scan to begin with; a form of every option; preflight; submit.
 */
import { html, useMemo, useState } from "../app/html.js";
import { get, post } from "../app/api.js";
import { counted } from "../app/format.js";
import { useLoad } from "../app/hooks.js";
import { go, to } from "../app/router.js";
import { Form } from "../form/form.js";
import { changed, mergePatch } from "../form/schema.js";
import { Loaded, ProblemBox } from "../parts/problem.js";
import { tell } from "../parts/told.js";
import { Uploader } from "../upload/uploader.js";
import { Preflight, askPreflight } from "./preflight.js";

export default function New({ query }) {
  const fork = query.get("fork");
  const state = useLoad(
    async (signal) => {
      const [schema, presets, parent] = await Promise.all([
        get("/v1/options", {}, signal),
        get("/v1/presets", {}, signal),
        fork ? get(`/v1/scans/${fork}`, {}, signal) : null,
      ]);
      return { schema, presets: presets.items, parent };
    },
    [fork],
  );
  return html`<h1>${fork ? "Fork a scan" : "New scan"}</h1>
    <${Loaded} state=${state}>${(given) => html`<${Editor} ...${given} plant=${query.get("plant")} />`}<//>`;
}

function Editor({ schema, presets, parent, plant }) {
  const first = parent?.spec ?? presets[0].spec;
  const [spec, setSpec] = useState(() => (plant && !parent ? { ...first, plant: { id: plant } } : first));
  const [problem, setProblem] = useState(null);
  const [answer, setAnswer] = useState(undefined);
  const [busy, setBusy] = useState(false);
  const key = useMemo(() => crypto.randomUUID?.() ?? String(Math.random()), [spec]);
  const complaints = useMemo(
    () => Object.fromEntries((problem?.errors ?? []).map((one) => [one.pointer, `${one.detail} ${one.hint ?? ""}`])),
    [problem],
  );
  const take = (next) => {
    setSpec(next);
    setAnswer(undefined);
    setProblem(null);
  };
  const patch = parent ? (mergePatch(parent.spec, spec) ?? {}) : null;

  const run = (work) => async (event) => {
    event?.preventDefault();
    setBusy(true);
    setProblem(null);
    try {
      await work();
    } catch (error) {
      setProblem(error);
    } finally {
      setBusy(false);
    }
  };
  const check = run(async () => setAnswer(await askPreflight(spec)));
  const submit = run(async () => {
    const headers = { "Idempotency-Key": key };
    const scan = await (parent
      ? post(`/v1/scans/${parent.id}/fork`, patch, headers)
      : post("/v1/scans", spec, headers));
    tell("The scan is submitted.");
    go(to(["scans", scan.id]));
  });
  const onCapture = (capture) => {
    take({ ...spec, source: capture.source, organs: [], name: spec.name });
    tell(`The files are there: ${counted(capture.files, "file")}.`);
  };
  return html`
    ${
      parent
        ? html`<p>What stays as it is in <a href=${to(["scans", parent.id])}>${parent.name}
          </a> is taken over, not computed.</p>`
        : html`<${Presets} presets=${presets} onTake=${(one) => take({ ...one, plant: spec.plant })} /><${Uploader}
          onCapture=${onCapture} />`
    }
    <form onSubmit=${submit} novalidate>
      <${Form} schema=${schema} value=${spec} complaints=${complaints}
        onChange=${(path, value) => take(changed(spec, path, value))} />
      <${Text} spec=${spec} onSpec=${take} />
      ${parent && html`<p class="small">Changes: <code>${JSON.stringify(patch)}</code></p>`}
      <${ProblemBox} problem=${problem} />
      <div class="buttons">
        <button type="button" disabled=${busy} onClick=${check}>What can it resolve?</button>
        <button class="main" disabled=${busy}>Submit the scan</button>
      </div>
      ${answer === null && html`<p class="small" role="status">This service has no preflight.</p>`}
      ${answer && html`<${Preflight} answer=${answer} />`}
    </form>
  `;
}

function Presets({ presets, onTake }) {
  return html`<div class="buttons" role="group" aria-label="Presets"><span class="soft">Begin with</span>
    ${presets.map((one) => html`<button type="button" onClick=${() => onTake(one.spec)}>${one.name}</button>`)}</div>`;
}

/** The specification as JSON, for who would rather paste one. */
function Text({ spec, onSpec }) {
  const [wrong, setWrong] = useState("");
  const onChange = (event) => {
    try {
      onSpec(JSON.parse(event.target.value));
      setWrong("");
    } catch (error) {
      setWrong(`This is no JSON: ${error.message}`);
    }
  };
  return html`<details><summary>As JSON</summary>
    <textarea class="spec" name="spec" aria-label="The specification as JSON" value=${JSON.stringify(spec, null, 2)}
      onChange=${onChange} spellcheck="false"></textarea>
    ${wrong && html`<p class="wrong" role="alert">${wrong}</p>`}</details>`;
}
