/**
 * Server-sent events over fetch (EventSource cannot send an API key): resumed from the last event that was seen.
 *
 * A lost connection is tried again after a growing, jittered wait. A page that nobody looks at lets go of its
 * connection and takes it up again, from where it stood, when it is shown.
 */
import { headersWith, problemOf } from "./api.js";

const FIRST_WAIT_MS = 500;
const LONGEST_WAIT_MS = 15_000;
const SILENCE_MS = 45_000; // three pings missed: the line is dead, whatever it says
const HIDDEN_MS = 20_000;

/** Split a growing text into whole events; `feed(text)` gives those that ended. */
export function parser() {
  let rest = "";
  return function feed(text) {
    rest += text.replaceAll("\r\n", "\n");
    const blocks = rest.split("\n\n");
    rest = blocks.pop();
    return blocks.map(eventOf).filter((event) => event.data !== "");
  };
}

function eventOf(block) {
  const event = { id: null, type: "message", data: "" };
  for (const line of block.split("\n")) {
    const [, field, value] = /^([^:]*):? ?(.*)$/.exec(line);
    if (field === "id") event.id = value;
    else if (field === "event") event.type = value;
    else if (field === "data") event.data += (event.data ? "\n" : "") + value;
  }
  return event;
}

/** Wait before try `n`, from 0: doubled each time, between half and all of it. */
export function waitBefore(tries, random = Math.random) {
  return Math.min(LONGEST_WAIT_MS, FIRST_WAIT_MS * 2 ** tries) * (0.5 + 0.5 * random());
}

/**
 * Listen until the returned function is called.
 *
 * `onEvent(type, data)` gets every event but pings; `onState("live" | "lost" | "refused", problem?)` every change, and
 * "live" again after a gap, when a snapshot is worth fetching anew.
 */
export function listen(path, { onEvent, onState = () => {} }) {
  let last = null;
  let tries = 0;
  let stopped = false;
  let abort = null;
  let timer = 0;
  let hiddenTimer = 0;

  async function connect() {
    abort = new AbortController();
    const watchdog = watch(abort);
    try {
      const headers = headersWith({ Accept: "text/event-stream", ...(last ? { "Last-Event-ID": last } : {}) });
      const response = await fetch(path, { headers, signal: abort.signal, cache: "no-store" });
      if (!response.ok) throw await problemOf(response);
      await read(response.body.pipeThrough(new TextDecoderStream()).getReader(), watchdog);
      throw new Error("the stream ended");
    } catch (error) {
      if (stopped || document.hidden) return;
      if (isFinal(error)) return onState("refused", error);
      onState("lost", error);
      timer = setTimeout(connect, waitBefore(tries++));
    } finally {
      watchdog.stop();
    }
  }

  async function read(reader, watchdog) {
    const feed = parser();
    onState("live");
    for (;;) {
      const { done, value } = await reader.read();
      if (done) return;
      watchdog.heard();
      tries = 0;
      for (const event of feed(value)) {
        last = event.id || last;
        if (event.type !== "ping") onEvent(event.type, JSON.parse(event.data));
      }
    }
  }

  function onVisibility() {
    clearTimeout(hiddenTimer);
    if (document.hidden) hiddenTimer = setTimeout(() => (clearTimeout(timer), abort?.abort()), HIDDEN_MS);
    else if (abort?.signal.aborted) connect();
  }

  document.addEventListener("visibilitychange", onVisibility);
  connect();
  return () => {
    stopped = true;
    clearTimeout(timer);
    clearTimeout(hiddenTimer);
    document.removeEventListener("visibilitychange", onVisibility);
    abort?.abort();
  };
}

const isFinal = (error) => error.status >= 400 && error.status < 500 && error.status !== 429;

function watch(abort) {
  let timer = 0;
  const heard = () => {
    clearTimeout(timer);
    timer = setTimeout(() => abort.abort(), SILENCE_MS);
  };
  heard();
  return { heard, stop: () => clearTimeout(timer) };
}
