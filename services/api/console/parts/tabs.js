/**
 * Parts of a page as links: each has an address of its own.
 */
import { html } from "../app/html.js";

export function Tabs({ label, tabs, current }) {
  return html`<nav class="tabs" aria-label=${label}>
    ${tabs.map(([key, text, href]) => html`<a href=${href} aria-current=${key === current ? "page" : null}>${text}
      </a>`)}
  </nav>`;
}
