// The person's choice of theme: system, light or dark. Remembered per browser.
const KEY = 'trocar.theme';
const watchers = new Set();
const system = matchMedia('(prefers-color-scheme: dark)');
const announce = () => watchers.forEach(watch => watch());
system.addEventListener('change', announce);

/** `'system' | 'light' | 'dark'`. */
export function themeChoice() {
  return document.documentElement.dataset.theme ?? 'system';
}

/** Is the page dark right now? Canvases ask, because they cannot inherit CSS colours. */
export function isDark() {
  const choice = themeChoice();
  return choice === 'system' ? system.matches : choice === 'dark';
}

export function chooseTheme(choice) {
  if (choice === 'system') delete document.documentElement.dataset.theme;
  else document.documentElement.dataset.theme = choice;
  try {
    localStorage.setItem(KEY, choice);
  } catch {
    // Not remembered where storage is refused; the choice still holds for this page.
  }
  announce();
}

/** Calls back when the colours change; returns what ends it. */
export function onThemeChange(callback) {
  watchers.add(callback);
  return () => watchers.delete(callback);
}

/** A custom property's value, for canvases. */
export function colour(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
}
