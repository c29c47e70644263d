/**
 * Light or dark: what the system says, until somebody chooses.
 */
const CHOICE = "nerfmodal.theme";
export const CHOICES = ["auto", "light", "dark"];

export const theme = () => localStorage.getItem(CHOICE) ?? "auto";

export function applyTheme(choice = theme()) {
  document.documentElement.dataset.theme = choice;
  if (choice === "auto") localStorage.removeItem(CHOICE);
  else localStorage.setItem(CHOICE, choice);
  window.dispatchEvent(new CustomEvent("nerfmodal:theme"));
}

/** The colour that a custom property has now, for what is drawn on a canvas. */
export function colour(name) {
  const probe = document.createElement("span");
  probe.style.color = `var(--${name})`;
  probe.hidden = true;
  document.body.append(probe);
  const value = getComputedStyle(probe).color;
  probe.remove();
  return value;
}
