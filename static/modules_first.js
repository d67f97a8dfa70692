// Preloads the texts and a page's modules before the first of them is parsed: on a slow connection each level of
// imports costs a round trip. A classic script, so that it runs while the page is parsed;
// tests/browser/loading.test.mjs compares its lists with the imports.
(() => {
  const MODULES = {
    today: `
      format.js pages/today.js parts/attention.js parts/course_state.js parts/own_courses.js parts/status.js`,
    session: `
      format.js pages/session.js parts/advice.js parts/chunk_loader.js parts/cohort_places.js parts/comments.js
      parts/curves.js parts/dialog.js parts/edit_dialog.js parts/edits.js parts/evidence.js parts/features.js
      parts/ghost.js parts/light.js parts/live_screen.js parts/live_space.js parts/live_tools.js parts/live_track.js
      parts/live_view.js parts/orbit.js parts/overlay.js parts/path3d.js parts/placement.js parts/playback.js
      parts/player.js parts/plots.js parts/quality.js parts/ratings.js parts/readouts.js parts/review.js
      parts/skill.js parts/space_painter.js parts/span_bar.js parts/status.js parts/track.js parts/verdict.js
      parts/with_error.js watch.js`,
    trainee: `
      format.js pages/trainee.js parts/axis.js parts/course_state.js parts/monitor_chart.js parts/own_courses.js
      parts/progress_plot.js parts/progress_summary.js parts/standard.js parts/status.js parts/strengths.js
      parts/with_error.js`,
    task: `
      format.js pages/task.js parts/axis.js parts/dialog.js parts/focus.js parts/raters.js parts/rescorings.js
      parts/skill_model.js parts/spread.js parts/spread_plot.js parts/standard.js parts/standard_form.js
      parts/standard_target.js parts/status.js`,
  };
  const ROOT = new URL('.', document.currentScript.src).pathname; // The folder of this version's files.
  const LANGUAGES = ['en', 'de'];
  // Same choice as in texts.js: otherwise a file would be loaded for nothing.
  const candidates = [storedLanguage(), ...navigator.languages.map(language => language.split('-')[0].toLowerCase()), 'en'];
  const textFile = `texts/${candidates.find(language => LANGUAGES.includes(language))}.js`;
  const [first, second, third] = location.pathname.split('/').filter(Boolean);
  const page = third ? null : !first ? 'today' : second && { sessions: 'session', trainees: 'trainee', tasks: 'task' }[first];
  for (const name of [textFile, ...(MODULES[page]?.trim().split(/\s+/) ?? [])])
    document.head.append(Object.assign(document.createElement('link'), { rel: 'modulepreload', href: ROOT + name }));

  function storedLanguage() {
    try {
      return localStorage.getItem('trocar.language');
    } catch {
      return null; // Storage is refused (private window): the browser's languages apply.
    }
  }
})();
