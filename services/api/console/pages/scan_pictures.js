/**
 * What the cameras saw: all of one frame, or one camera large, with a slider through time.
 */
import { html, useEffect, useRef, useState } from "../app/html.js";
import { get, send } from "../app/api.js";
import { number } from "../app/format.js";
import { useLoad } from "../app/hooks.js";
import { ProblemBox } from "../parts/problem.js";
import { FrameSlider, framesOf } from "./scan_frames.js";

export function Pictures({ scan, ticks }) {
  const frames = framesOf(scan);
  const [frame, setFrame] = useState(0);
  const [camera, setCamera] = useState("");
  const state = useLoad(
    (signal) => get(`/v1/scans/${scan.id}/frames/${frame}/pictures`, {}, signal),
    [scan.id, frame],
    [frame ? 0 : ticks],
  );
  const items = state.value?.items ?? [];
  if (scan.source === "clouds")
    return html`<p class="wait">This scan began with point clouds: there are no pictures.</p>`;
  return html`
    <${FrameSlider} frames=${frames} frame=${frame} onFrame=${setFrame} time=${items[0]?.time_s} />
    ${state.problem?.status === 404 ? html`<p
      class="wait">The pictures of frame ${frame} are not made yet.</p>` : html`<${ProblemBox}
      problem=${state.problem} />`}
    ${
      camera
        ? html`<div class="big"><p><button onClick=${() => setCamera("")}>← All cameras</button> <strong>${camera}
          </strong></p>
          <${Picture} scan=${scan.id} frame=${frame} camera=${camera} /></div>`
        : html`<div class="pictures">${items.map(
            (one) => html`<figure key=${one.camera}>
          <button onClick=${() => setCamera(one.camera)}><${Picture} scan=${scan.id} frame=${frame}
            camera=${one.camera} /></button>
          <figcaption class="small">
            ${one.camera} · ${one.width} × ${one.height} px · ${number(one.time_s)} s</figcaption></figure>`,
          )}</div>`
    }
  `;
}

/** A picture that is fetched with the key, when it comes into view; the old one stays until the new one is there. */
function Picture({ scan, frame, camera }) {
  const [source, setSource] = useState("");
  const [seen, setSeen] = useState(false);
  const image = useRef(null);
  useEffect(() => {
    const observer = new IntersectionObserver((entries) => setSeen(entries.some((one) => one.isIntersecting)));
    observer.observe(image.current);
    return () => observer.disconnect();
  }, []);
  useEffect(() => {
    if (!seen) return undefined;
    const abort = new AbortController();
    const path = `/v1/scans/${scan}/frames/${frame}/pictures/${encodeURIComponent(camera)}`;
    send(path, { signal: abort.signal })
      .then((answer) => answer.blob())
      .then(
        (blob) => setSource(URL.createObjectURL(blob)),
        () => {},
      );
    return () => abort.abort();
  }, [scan, frame, camera, seen]);
  useEffect(() => () => source && URL.revokeObjectURL(source), [source]);
  return html`<img ref=${image} src=${source || PIXEL} alt=${`Camera ${camera}, frame ${frame}`} />`;
}

const PIXEL = "data:image/gif;base64,R0lGODlhAQABAAAAACwAAAAAAQABAAA=";
