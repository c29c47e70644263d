/**
 * The HTTP API: JSON in and out, an API key where one was given, refusals as `Problem`.
 *
 * The key lives in sessionStorage: it ends with the tab, and is sent in a header alone, never in an address.
 */
const KEY = "nerfmodal.key";
export const KEY_NEEDED = "nerfmodal:key-needed";

/** A refusal (RFC 9457), or a connection that failed (`status` 0). */
export class Problem extends Error {
  constructor(body) {
    super(body.detail || body.title || "The request failed.");
    this.name = "Problem";
    this.status = body.status ?? 0;
    this.code = body.code ?? "";
    this.detail = this.message;
    this.hint = body.hint ?? "";
    this.pointer = body.pointer ?? null;
    this.requestId = body.request_id ?? "";
    this.errors = body.errors?.length ? body.errors : body.pointer ? [body] : [];
  }
}

export const apiKey = () => sessionStorage.getItem(KEY) ?? "";

export function keepKey(secret) {
  if (secret) sessionStorage.setItem(KEY, secret);
  else sessionStorage.removeItem(KEY);
}

/** Headers of every request: the key, if there is one, and what is given. */
export function headersWith(more = {}) {
  const key = apiKey();
  return key ? { Authorization: `Bearer ${key}`, ...more } : { ...more };
}

/** An address with its query; what is empty is left out, lists are repeated. */
export function address(path, query = {}) {
  const words = new URLSearchParams();
  for (const [name, value] of Object.entries(query)) {
    for (const one of Array.isArray(value) ? value : [value]) {
      if (one !== undefined && one !== null && one !== "") words.append(name, one);
    }
  }
  return words.size ? `${path}?${words}` : path;
}

/** The response of a request that was not refused: `body` goes as JSON, `raw` as it is. Throws `Problem`. */
export async function send(path, { method = "GET", body, raw, headers = {}, signal } = {}) {
  const said = body === undefined ? {} : { "Content-Type": "application/json" };
  let response;
  try {
    response = await fetch(path, {
      method,
      signal,
      headers: headersWith({ ...said, ...headers }),
      body: body === undefined ? raw : JSON.stringify(body),
    });
  } catch (error) {
    if (error.name === "AbortError") throw error;
    throw new Problem({ code: "NO_CONNECTION", detail: "The service cannot be reached.", hint: "Is it running?" });
  }
  if (!response.ok) throw await problemOf(response);
  return response;
}

/** What a refusal says; an answer that is no problem+json is told by its status. */
export async function problemOf(response) {
  let body = {};
  try {
    body = await response.json();
  } catch {
    body = { detail: `The service answered ${response.status} ${response.statusText}.` };
  }
  if (response.status === 401) window.dispatchEvent(new CustomEvent(KEY_NEEDED));
  return new Problem({ ...body, status: response.status });
}

export const get = async (path, query, signal) => (await send(address(path, query), { signal })).json();

export async function post(path, body, headers) {
  const response = await send(path, { method: "POST", body, headers });
  return response.status === 204 ? null : response.json();
}

export const patch = async (path, body) => (await send(path, { method: "PATCH", body })).json();
export const remove = (path) => send(path, { method: "DELETE" });

/** Save a file: by a plain link where no key is needed, else fetched with the key first. */
export async function download(path, name) {
  if (!apiKey()) return clickOn(path, name);
  const blob = await (await send(path)).blob();
  const link = URL.createObjectURL(blob);
  clickOn(link, name);
  setTimeout(() => URL.revokeObjectURL(link), 60_000);
}

function clickOn(href, name) {
  const anchor = document.createElement("a");
  anchor.href = href;
  anchor.download = name;
  anchor.click();
}
