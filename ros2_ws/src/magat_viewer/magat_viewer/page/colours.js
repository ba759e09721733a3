// The theme's colours, for what is drawn on canvases.

const NAMES = ["paper", "card", "ink", "quiet", "line", "grid", "wall", "accent", "alarm", "sight", "halo"];
const ROBOTS = 12;

export const colours = { robots: [] };

// Take the theme that is asked for, else the system's.
export function setTheme(theme) {
  const dark = matchMedia("(prefers-color-scheme: dark)").matches;
  document.documentElement.dataset.theme = theme || (dark ? "dark" : "light");
  const style = getComputedStyle(document.documentElement);
  for (const name of NAMES) colours[name] = style.getPropertyValue(`--${name}`).trim();
  colours.robots = Array.from({ length: ROBOTS }, (_, i) => style.getPropertyValue(`--robot-${i}`).trim());
}

export const isDark = () => document.documentElement.dataset.theme === "dark";
export const inkOf = (robot) => colours.robots[robot % ROBOTS];
export const inks = ROBOTS;
