/**
 * Resumable uploads (tus 1.0): a file goes in pieces; what is on the service's disk is never sent twice.
 *
 * A file is known again by name, size and time of change, which localStorage keeps beside its upload's address: after a
 * reload the same file goes on where it stood.
 */
import { Problem, headersWith, problemOf } from "../app/api.js";
import { waitBefore } from "../app/stream.js";

const PIECE = 4 << 20;
const TRIES = 8;
const KNOWN = "nerfmodal.uploads";
const VERSION = { "Tus-Resumable": "1.0.0" };

export const nameOf = (file) => file.relativeName ?? file.webkitRelativePath ?? file.name;
const identity = (file) => `${nameOf(file) || file.name}|${file.size}|${file.lastModified}`;

function known() {
  return JSON.parse(localStorage.getItem(KNOWN) ?? "{}");
}

function remember(file, address) {
  const all = { ...known(), [identity(file)]: address };
  if (!address) delete all[identity(file)];
  localStorage.setItem(KNOWN, JSON.stringify(all));
}

/** Forget what became part of a capture. */
export const forget = (files) => files.forEach((file) => remember(file, null));

/** Whether a file was begun before, and by which address. */
export const begun = (file) => known()[identity(file)] ?? null;

/** Send a file; `onProgress(bytes)` as they arrive. Resolves to the upload's id. Throws `Problem`. */
export async function upload(file, { onProgress = () => {}, signal } = {}) {
  for (let tries = 0; ; tries++) {
    try {
      return await attempt(file, onProgress, signal);
    } catch (error) {
      if (signal?.aborted || !isPassing(error) || tries >= TRIES) throw error;
      await new Promise((wake) => setTimeout(wake, waitBefore(tries)));
    }
  }
}

const isPassing = (error) => error.status === 0 || error.status >= 500 || [409, 423, 429, 460].includes(error.status);

async function attempt(file, onProgress, signal) {
  let [address, offset] = await standing(file, signal);
  if (!address) {
    const metadata = `filename ${encoded(nameOf(file) || file.name)}${file.type ? `,filetype ${encoded(file.type)}` : ""}`;
    const made = await send("/v1/uploads", {
      method: "POST",
      headers: { "Upload-Length": String(file.size), "Upload-Metadata": metadata },
      signal,
    });
    [address, offset] = [made.headers.get("Location"), Number(made.headers.get("Upload-Offset") ?? 0)];
    remember(file, address);
  }
  onProgress(offset);
  while (offset < file.size) {
    const answer = await send(address, {
      method: "PATCH",
      headers: { "Upload-Offset": String(offset), "Content-Type": "application/offset+octet-stream" },
      body: file.slice(offset, offset + PIECE),
      signal,
    });
    offset = Number(answer.headers.get("Upload-Offset"));
    onProgress(offset);
  }
  return address.split("/").at(-1);
}

/** Address and offset of an earlier try that the service still has, else nothing. */
async function standing(file, signal) {
  const address = begun(file);
  if (!address) return [null, 0];
  try {
    const answer = await send(address, { method: "HEAD", signal });
    if (Number(answer.headers.get("Upload-Length")) === file.size)
      return [address, Number(answer.headers.get("Upload-Offset"))];
  } catch (problem) {
    if (problem.status !== 404) throw problem;
  }
  remember(file, null);
  return [null, 0];
}

async function send(path, { headers, ...options }) {
  let response;
  try {
    response = await fetch(path, { ...options, headers: headersWith({ ...VERSION, ...headers }) });
  } catch (error) {
    if (error.name === "AbortError") throw error;
    throw new Problem({ code: "NO_CONNECTION", detail: "The connection broke; it is tried again." });
  }
  if (!response.ok) throw await problemOf(response);
  return response;
}

function encoded(text) {
  return btoa(String.fromCharCode(...new TextEncoder().encode(text)));
}
