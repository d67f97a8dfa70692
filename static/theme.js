// The person's choice of theme: system, light or dark. Stored per browser.
const KEY = 'trocar.theme';
const watchers = new Set();
const system = matchMedia('(prefers-color-scheme: dark)');
const notify = () => watchers.forEach(callback => callback());
system.addEventListener('change', notify);

/** `'system' | 'light' | 'dark'`. */
export function themeChoice() {
  return document.documentElement.dataset.theme ?? 'system';
}

/** Whether the page is dark now. Canvases ask, because they cannot inherit CSS colours. */
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
    // Storage is refused: the choice holds for this page only.
  }
  notify();
}

/** Calls back when the colours change; returns a function that unsubscribes. */
export function onThemeChange(callback) {
  watchers.add(callback);
  return () => watchers.delete(callback);
}

/** The value of a custom property, for canvases. */
export function colour(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
}
