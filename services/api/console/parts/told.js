/**
 * What was done, said once: shown for a while and read out.
 */
import { html, useEffect, useState } from "../app/html.js";

const TOLD = "nerfmodal:told";
const SHOWN_MS = 6000;

/** Say something to the reader. */
export const tell = (text) => window.dispatchEvent(new CustomEvent(TOLD, { detail: text }));

export function Told() {
  const [text, setText] = useState("");
  useEffect(() => {
    let timer = 0;
    const onTold = (event) => {
      setText(event.detail);
      clearTimeout(timer);
      timer = setTimeout(() => setText(""), SHOWN_MS);
    };
    window.addEventListener(TOLD, onTold);
    return () => window.removeEventListener(TOLD, onTold);
  }, []);
  return html`<div class=${text ? "told shown" : "told"} role="status" aria-live="polite">${text}</div>`;
}
