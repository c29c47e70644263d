/**
 * Reason codes in the words of the service.
 */
import { html, useEffect, useState } from "../app/html.js";
import { words } from "../app/words.js";

/** The reasons of a verdict in the service's own words. */
export function Reasons({ codes }) {
  const [known, setKnown] = useState({});
  useEffect(() => {
    words().then(
      (found) => setKnown(found.reasons),
      () => {},
    );
  }, []);
  return codes?.length
    ? html`<ul class="reasons">${codes.map((code) => html`<li><code>${code}</code> ${known[code] ?? ""}</li>`)}</ul>`
    : null;
}
