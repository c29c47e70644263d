/**
 * When a plant is scanned and from what: the same fields make and change a schedule.
 */
import { html, useState } from "../app/html.js";

const FIRST_SPEC = { source: { kind: "capture", path: "incoming/{plant}/{date}" } };

export function ScheduleFields({ schedule }) {
  const [rhythm, setRhythm] = useState(schedule?.cron ? "cron" : "hours");
  const about = `about-spec-${schedule?.id ?? "new"}`;
  const choice = (value, text) => html`<label class="row"><input type="radio" name="rhythm" value=${value}
    checked=${rhythm === value} onChange=${() => setRhythm(value)} /><span>${text}</span></label>`;
  return html`<fieldset><legend>When</legend>
      <div class="ticks">${choice("hours", "every so many hours")}${choice("cron", "at times as cron writes them")}</div>
      <div class="fields">
        ${
          rhythm === "hours"
            ? html`<label>Hours between scans <input type="number" name="every_hours" min="0.1" max="8760" step="any"
                required defaultValue=${schedule?.every_hours ?? 12} /></label>`
            : html`<label>Minute, hour, day, month, weekday <input name="cron" required placeholder="0 6,18 * * *"
                defaultValue=${schedule?.cron ?? ""} /></label><label>Time zone <input name="time_zone"
                placeholder="America/Belem" defaultValue=${schedule?.time_zone ?? localZone()} /></label>`
        }
        <label>Minutes that files may be late <input type="number" name="grace_minutes" min="0" max="10080" step="any"
          required defaultValue=${schedule?.grace_minutes ?? 60} /></label>
      </div></fieldset>
    <label>Specification as JSON <textarea class="spec" name="spec" required spellcheck=${false}
      aria-describedby=${about} defaultValue=${JSON.stringify(schedule?.spec ?? FIRST_SPEC, null, 2)} /></label>
    <p class="small" id=${about}>Without the plant; <code>{plant}</code>, <code>{date}</code> and <code>{time}</code> in
      a path stand for themselves.</p>`;
}

const localZone = () => Intl.DateTimeFormat().resolvedOptions().timeZone || "UTC";

/** What the fields of a form say, as the service wants it. Throws where the specification is no JSON. */
export function said(form) {
  const found = Object.fromEntries(new FormData(form));
  const when = found.rhythm === "cron" ? cronOf(found) : { every_hours: Number(found.every_hours) };
  return { ...when, grace_minutes: Number(found.grace_minutes), spec: specOf(found.spec) };
}

/** Of what is said only what is another: a time that is sent again counts from now. */
export function changed(schedule, wanted) {
  const isOther = ([name, value]) => JSON.stringify(value) !== JSON.stringify(schedule[name]);
  return Object.fromEntries(Object.entries(wanted).filter(isOther));
}

const cronOf = ({ cron, time_zone: zone }) => ({ cron: cron.trim(), time_zone: zone.trim() || "UTC" });

function specOf(text) {
  try {
    return JSON.parse(text);
  } catch (error) {
    throw new Error(`The specification is no JSON: ${error.message}`);
  }
}
