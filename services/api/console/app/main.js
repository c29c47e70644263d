/**
 * The shell: navigation, the page that the address names, the key where one is needed, light and dark.
 */
import { html, render, useEffect, useErrorBoundary, useState } from "./html.js";
import { KEY_NEEDED, apiKey, get, keepKey } from "./api.js";
import { load } from "./load.js";
import { HOME, PAGES, fileOf } from "./pages.js";
import { to, usePlace } from "./router.js";
import { CHOICES, applyTheme, theme } from "./theme.js";
import { KeyDialog } from "../parts/key.js";
import { Told } from "../parts/told.js";
import { ProblemBox } from "../parts/problem.js";

function Shell() {
  const here = usePlace();
  const [asking, setAsking] = useState(false);
  const [session, setSession] = useState(0);
  useEffect(() => {
    const ask = () => setAsking(true);
    window.addEventListener(KEY_NEEDED, ask);
    return () => window.removeEventListener(KEY_NEEDED, ask);
  }, []);
  const name = here.parts[0] ?? HOME;
  useEffect(() => {
    // on a phone the pages stand in a row that is wider than the screen
    document.querySelector(".top nav [aria-current]")?.scrollIntoView({ block: "nearest", inline: "center" });
  }, [name]);
  const onKey = (secret) => {
    keepKey(secret);
    setAsking(false);
    setSession((old) => old + 1);
  };
  return html`
    <a class="skip" href="#main" onClick=${focusMain}>Skip to content</a>
    <header class="top">
      <a class="brand" href=${to([])}><img src=${new URL("../icon.svg", import.meta.url).href} alt="" /> nerfmodal</a>
      <nav aria-label="Pages">
        ${Object.entries(PAGES).map(
          ([key, page]) => html`<a href=${to([key])} aria-current=${key === name ? "page" : null}>${page.label}</a>`,
        )}
      </nav>
      <${Appearance} onKey=${() => setAsking(true)} />
    </header>
    <main id="main" tabindex="-1"><${Page} key=${session} name=${name} here=${here} /></main>
    <${Told} />
    <${KeyDialog} open=${asking} onKey=${onKey} onClose=${() => setAsking(false)} />
  `;
}

function focusMain(event) {
  event.preventDefault();
  document.getElementById("main").focus();
}

function Appearance({ onKey }) {
  const [choice, setChoice] = useState(theme());
  const next = CHOICES[(CHOICES.indexOf(choice) + 1) % CHOICES.length];
  const change = () => {
    applyTheme(next);
    setChoice(next);
  };
  return html`<div class="appearance">
    <button class="quiet" onClick=${onKey} title="API key">${apiKey() ? "Key set" : "Key"}</button>
    <button class="quiet" onClick=${change} aria-label=${`Colours: ${choice}. Change to ${next}`}>
      ${{ auto: "◐ auto", light: "☀ light", dark: "☾ dark" }[choice]}
    </button>
  </div>`;
}

/** The page that a name and an optional id stand for, loaded when it is first shown. */
function Page({ name, here }) {
  const [, id, ...rest] = here.parts;
  const which = fileOf(here.parts);
  const [found, setFound] = useState(null);
  const [problem, clear] = useErrorBoundary((error) => console.error(error));
  useEffect(() => {
    let gone = false;
    clear();
    if (!which) return undefined;
    load(which).then(
      (module) => gone || setFound({ which, View: module.default }),
      (error) => gone || setFound({ which, error }),
    );
    return () => (gone = true);
  }, [which, id]);
  useEffect(() => {
    document.title = `${PAGES[name]?.label ?? "Not found"} · nerfmodal`;
  }, [name]);
  if (problem || found?.error) return html`<${ProblemBox} problem=${problem ?? found.error} />`;
  if (!which) return html`<h1>There is no such page</h1><p><a href=${to([])}>Go to the plants.</a></p>`;
  if (found?.which !== which) return html`<p class="wait">Loading …</p>`;
  return html`<${found.View} key=${`${which} ${id ?? ""}`} id=${id} rest=${rest} query=${here.query} />`;
}

applyTheme();
render(html`<${Shell} />`, document.getElementById("page"));
get("/v1/info").catch(() => {}); // asks for the key at once where one is needed
