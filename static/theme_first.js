// Runs before the first paint, as a classic script: a module would run after it and flash the wrong theme.
(() => {
  try {
    const chosen = localStorage.getItem('trocar.theme');
    if (chosen === 'light' || chosen === 'dark') document.documentElement.dataset.theme = chosen;
  } catch {
    // Storage is refused (private window): the system's theme applies.
  }
})();
