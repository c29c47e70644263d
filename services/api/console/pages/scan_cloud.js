/**
 * The point cloud of a frame in space, with the slider through time.
 */
import { html, useEffect, useState } from "../app/html.js";
import { ProblemBox } from "../parts/problem.js";
import { fetchCloud } from "../space/points.js";
import { Space } from "../space/view.js";
import { FrameSlider, framesOf } from "./scan_frames.js";

const MOST = 100_000;

export function Cloud({ scan, ticks }) {
  const [frame, setFrame] = useState(0);
  const [cloud, setCloud] = useState(null);
  const [said, setSaid] = useState({});
  useEffect(() => {
    const abort = new AbortController();
    fetchCloud(scan.id, frame, MOST, abort.signal).then(
      (found) => {
        if (found) setCloud({ ...found, key: scan.id });
        setSaid({ missing: !found });
      },
      (problem) => problem.name === "AbortError" || setSaid({ problem }),
    );
    return () => abort.abort();
  }, [scan.id, frame, cloud ? 0 : ticks]);
  return html`
    <${FrameSlider} frames=${framesOf(scan)} frame=${frame} onFrame=${setFrame} />
    <${ProblemBox} problem=${said.problem} />
    ${said.missing && html`<p class="wait" role="status">${missing(scan, frame)}</p>`}
    <${Space} cloud=${cloud} label=${`Point cloud of frame ${frame}`} />
    ${cloud && html`<p class="small">
      ${cloud.count.toLocaleString()} of ${cloud.total.toLocaleString()} points. Drag turns, the wheel zooms, the right button moves.</p>`}
  `;
}

const missing = (scan, frame) =>
  scan.source === "clouds"
    ? "This scan began with point clouds; they stay where they were sent from."
    : `The cloud of frame ${frame} is not made yet.`;
