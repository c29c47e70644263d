/**
 * Files of `pages/`, loaded when they are first shown, with all that they import at once: found one import after another,
 * each would wait for the file that names it. The service writes into the page which file imports what.
 */
import { fileOf } from "./pages.js";
import { place } from "./router.js";

const imports = JSON.parse(document.getElementById("imports").textContent);
const asked = new Set();

/** The module of a file in `pages/`, by its name without suffix. */
export function load(file) {
  ahead(file);
  return import(`../pages/${file}.js`);
}

function ahead(file) {
  for (const name of imports[file] ?? []) {
    if (asked.has(name)) continue;
    asked.add(name);
    const link = document.createElement("link");
    link.rel = "modulepreload";
    link.href = new URL(`../${name}`, import.meta.url).href;
    document.head.append(link);
  }
}

ahead(fileOf(place().parts));
