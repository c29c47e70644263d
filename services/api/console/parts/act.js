/**
 * Something a button does: busy while it runs, and what was refused is shown where the button is.
 */
import { useState } from "../app/html.js";

/** `run(work)` does it; `busy` and `problem` say how it goes. */
export function useAct() {
  const [state, setState] = useState({ busy: false, problem: null });
  const run = async (work) => {
    setState({ busy: true, problem: null });
    try {
      await work();
      setState({ busy: false, problem: null });
    } catch (problem) {
      setState({ busy: false, problem });
    }
  };
  return { ...state, run };
}
