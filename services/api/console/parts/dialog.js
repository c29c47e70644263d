/**
 * A modal dialog: the browser's own, with its focus trap and Escape.
 */
import { html, useEffect, useRef, useState } from "../app/html.js";
import { ProblemBox } from "./problem.js";

export function Dialog({ open, title, onClose, wide = false, children }) {
  const element = useRef(null);
  useEffect(() => {
    const dialog = element.current;
    if (open && !dialog.open) dialog.showModal();
    if (!open && dialog.open) dialog.close();
  }, [open]);
  // The browser tells of a close later: of one that was opened again by then it is old news.
  const closed = () => element.current?.open || onClose();
  return html`<dialog ref=${element} class=${wide ? "wide" : ""} onClose=${closed} aria-label=${title}>
    ${open && html`<h2>${title}</h2>${children}`}
  </dialog>`;
}

/** Ask before something that cannot be undone; `work` runs on yes, and what it refuses is shown. */
export function Confirm({ open, title, text, yes, danger = false, work, onClose }) {
  const [state, setState] = useState({ busy: false, problem: null });
  const run = async () => {
    setState({ busy: true, problem: null });
    try {
      await work();
      setState({ busy: false, problem: null });
      onClose();
    } catch (problem) {
      setState({ busy: false, problem });
    }
  };
  return html`<${Dialog} open=${open} title=${title} onClose=${onClose}>
    <p>${text}</p>
    <${ProblemBox} problem=${state.problem} />
    <div class="buttons">
      <button onClick=${onClose}>No, go back</button>
      <button class=${danger ? "danger" : "main"} disabled=${state.busy} onClick=${run}>${yes}</button>
    </div>
  <//>`;
}
