/**
 * The stage as a component: points, a motion, how they are shown; and in a corner what it manages to draw.
 */
import { html, useEffect, useRef, useState } from "../app/html.js";
import { createStage } from "./stage.js";

/** `cloud` is {positions, colours, key}, `motion` a Float32Array or null; a new `key` moves the camera. */
export function Space({ cloud, motion = null, settings = {}, label }) {
  const canvas = useRef(null);
  const stage = useRef(null);
  const shownKey = useRef(null);
  const [rate, setRate] = useState(null);
  const [missing, setMissing] = useState("");
  useEffect(() => {
    try {
      stage.current = createStage(canvas.current, { onRate: setRate });
    } catch (error) {
      setMissing("This browser has no WebGL; the animation cannot be shown. The report has the shapes as pictures.");
    }
    return () => stage.current?.dispose();
  }, []);
  useEffect(() => {
    if (!cloud || !stage.current) return;
    stage.current.setPoints(cloud.positions, cloud.colours, { keepView: shownKey.current === cloud.key });
    shownKey.current = cloud.key;
    stage.current.setMotion(motion);
  }, [cloud]);
  useEffect(() => {
    if (cloud && stage.current) stage.current.setMotion(motion);
  }, [motion]);
  useEffect(() => stage.current?.set(settings), [JSON.stringify(settings)]);
  const count = cloud ? cloud.positions.length / 3 : 0;
  return html`<div class="stage">
    <canvas ref=${canvas} tabindex="0" role="img" aria-label=${`${label}. Arrow keys turn it, plus and minus zoom.`}
      data-points=${count} data-shown=${rate?.shown ?? count} data-fps=${rate ? rate.fps.toFixed(1) : ""}></canvas>
    ${
      missing
        ? html`<p class="corner" role="alert">${missing}</p>`
        : html`<span class="corner">
          ${rate && settings.on ? `${Math.round(rate.fps)} pictures/s · ` : ""}${(settings.on ? (rate?.shown ?? count) : count).toLocaleString()}${settings.on && rate && rate.shown < rate.all ? ` of ${rate.all.toLocaleString()}` : ""} points</span>`
    }
  </div>`;
}
