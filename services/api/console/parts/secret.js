/**
 * A secret, shown once: to be copied before it is gone for good.
 */
import { html, useState } from "../app/html.js";
import { Dialog } from "./dialog.js";

export function Secret({ secret, what = "It", onClose }) {
  const [said, setSaid] = useState("");
  const copy = () =>
    navigator.clipboard.writeText(secret).then(
      () => setSaid("It is copied."),
      () => setSaid("The browser does not let it be copied: mark it and copy it by hand."),
    );
  const close = () => {
    setSaid("");
    onClose();
  };
  return html`<${Dialog} open=${secret !== ""} title="Keep this secret now" onClose=${close}>
    <p>${what} is shown this once and cannot be read again.</p><p><code class="secret">${secret}</code></p>
    <p class="small" role="status">${said}</p>
    <div class="buttons"><button onClick=${copy}>Copy</button><button class="main" onClick=${close}>I have it</button>
    </div><//>`;
}
