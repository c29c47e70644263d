/**
 * The slider through the frames of a scan, with a button that plays them.
 */
import { html, useEffect, useState } from "../app/html.js";
import { number } from "../app/format.js";

const PLAY_MS = 200;

/** How many frames a scan has, as far as its plan tells. */
export function framesOf(scan) {
  const kinds = scan.progress.filter((row) => ["frame.render", "frame.read", "frame.extract"].includes(row.step));
  return Math.max(1, scan.spec.source.frames ?? 0, ...kinds.map((row) => row.total));
}

export function FrameSlider({ frames, frame, onFrame, time }) {
  const [playing, setPlaying] = useState(false);
  useEffect(() => {
    if (!playing) return undefined;
    const timer = setTimeout(() => onFrame((frame + 1) % frames), PLAY_MS);
    return () => clearTimeout(timer);
  }, [playing, frame, frames]);
  return html`<div class="controls">
    <button aria-pressed=${playing} onClick=${() => setPlaying(!playing)}>${playing ? "■ Stop" : "▶ Play"}</button>
    <label class="grow">Frame ${frame} of ${frames}${time != null ? `, ${number(time)} s` : ""}
      <input type="range" name="frame" min="0" max=${frames - 1} value=${frame}
        onInput=${(event) => onFrame(Number(event.target.value))} />
    </label>
  </div>`;
}
