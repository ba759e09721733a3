// Copyright 2026 MAGAT maintainers
// SPDX-License-Identifier: Apache-2.0

// The colours of the current theme, for drawing on canvases.

const NAMES = ["paper", "card", "ink", "quiet", "line", "grid", "wall", "accent", "alarm", "view", "halo"];

export const colours = { robots: [] };

// Use the given theme ("light" or "dark"), or that of the system.
export function setTheme(theme) {
  const dark = matchMedia("(prefers-color-scheme: dark)").matches;
  document.documentElement.dataset.theme = theme || (dark ? "dark" : "light");
  const style = getComputedStyle(document.documentElement);
  const value = (name) => style.getPropertyValue(`--${name}`).trim();
  for (const name of NAMES) colours[name] = value(name);
  colours.robots = Array.from({ length: Number(value("robots")) }, (_, robot) => value(`robot-${robot}`));
}

export const isDark = () => document.documentElement.dataset.theme === "dark";
export const colourOf = (robot) => colours.robots[robot % colours.robots.length];
