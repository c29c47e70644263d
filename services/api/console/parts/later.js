/**
 * A component that is loaded when it is first shown: `name` in `pages/file.js`; the other properties are its own.
 */
import { html, useEffect, useState } from "../app/html.js";
import { load } from "../app/load.js";
import { ProblemBox } from "./problem.js";

export function Later({ file, name, ...rest }) {
  const [View, setView] = useState(null);
  const [problem, setProblem] = useState(null);
  useEffect(() => {
    let gone = false;
    load(file).then(
      (module) => gone || setView(() => module[name]),
      (error) => gone || setProblem(error),
    );
    return () => (gone = true);
  }, [file, name]);
  if (problem) return html`<${ProblemBox} problem=${problem} />`;
  return View ? html`<${View} ...${rest} />` : html`<p class="wait">Loading …</p>`;
}
