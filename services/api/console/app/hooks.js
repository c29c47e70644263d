/**
 * What pages share: loading with a state of its own, listening, and drawing anew after a while.
 */
import { useCallback, useEffect, useRef, useState } from "./html.js";
import { listen } from "./stream.js";

/**
 * Load a value: `load(signal)` runs when `needs` or `again` change and on `reload()`. The old value stays until the new
 * one is there, unless `needs` changed: then it is another thing.
 */
export function useLoad(load, needs, again = []) {
  const [state, setState] = useState({ value: null, problem: null, loading: true });
  const [turn, setTurn] = useState(0);
  const seen = useRef(null);
  useEffect(() => {
    const abort = new AbortController();
    const isNew = JSON.stringify(needs) !== seen.current;
    seen.current = JSON.stringify(needs);
    setState((old) => ({ value: isNew ? null : old.value, problem: null, loading: true }));
    load(abort.signal).then(
      (value) => abort.signal.aborted || setState({ value, problem: null, loading: false }),
      (problem) => abort.signal.aborted || setState((old) => ({ value: old.value, problem, loading: false })),
    );
    return () => abort.abort();
  }, [...needs, ...again, turn]);
  const reload = useCallback(() => setTurn((old) => old + 1), []);
  return { ...state, reload };
}

/** Call `work` at most once in `ms`, and once more after the last call. */
export function useCalm(work, ms) {
  const latest = useRef(work);
  latest.current = work;
  const timer = useRef(0);
  useEffect(() => () => clearTimeout(timer.current), []);
  return useCallback(() => {
    if (timer.current) return;
    timer.current = setTimeout(() => {
      timer.current = 0;
      latest.current();
    }, ms);
  }, [ms]);
}

/**
 * Listen while the component is shown; the state of the connection.
 *
 * `onBack` is called when the line is live again after a gap, and with `eager` when it is live at first: what happened
 * between the snapshot and the stream's beginning is in neither.
 */
export function useStream(path, onEvent, onBack = () => {}, eager = false) {
  const [state, setState] = useState("connecting");
  const latest = useRef({ onEvent, onBack });
  latest.current = { onEvent, onBack };
  useEffect(() => {
    if (!path) return undefined;
    let wasLost = eager;
    return listen(path, {
      onEvent: (type, data) => latest.current.onEvent(type, data),
      onState: (now) => {
        setState(now);
        if (now === "live" && wasLost) latest.current.onBack();
        wasLost = now === "lost";
      },
    });
  }, [path]);
  return state;
}

/** Draw anew when the colours change. */
export function useTheme() {
  const [count, setCount] = useState(0);
  useEffect(() => {
    const media = matchMedia("(prefers-color-scheme: dark)");
    const onChange = () => setCount((old) => old + 1);
    media.addEventListener("change", onChange);
    window.addEventListener("nerfmodal:theme", onChange);
    return () => {
      media.removeEventListener("change", onChange);
      window.removeEventListener("nerfmodal:theme", onChange);
    };
  }, []);
  return count;
}
