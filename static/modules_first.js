// Asks for the words and a page's modules before the first of them has told what it imports, level by level: on a slow line each level is a
// round trip. A classic script, so that it runs while the page is read; tests/browser/loading.test.mjs holds it against the imports.
(() => {
  const MODULES = {
    today: `
      format.js pages/today.js parts/attention.js parts/course_state.js parts/own_courses.js parts/status.js`,
    session: `
      format.js pages/session.js parts/advice.js parts/comments.js parts/curves.js parts/dialog.js
      parts/edit_dialog.js parts/edits.js parts/features.js parts/ghost.js parts/light.js parts/live_screen.js
      parts/live_space.js parts/live_tools.js parts/live_track.js parts/live_view.js parts/orbit.js
      parts/overlay.js parts/parts_loader.js parts/path3d.js parts/placement.js parts/places.js parts/playback.js
      parts/player.js parts/plots.js parts/quality.js parts/ratings.js parts/readouts.js parts/review.js
      parts/seconds.js parts/skill.js parts/space_painter.js parts/span_bar.js parts/status.js parts/track.js
      parts/verdict.js parts/with_error.js watch.js`,
    trainee: `
      format.js pages/trainee.js parts/axis.js parts/balance.js parts/course_state.js parts/monitor_chart.js
      parts/own_courses.js parts/progress_plot.js parts/progress_words.js parts/standard.js parts/status.js
      parts/with_error.js`,
    task: `
      format.js pages/task.js parts/axis.js parts/dialog.js parts/focus.js parts/raters.js parts/rescorings.js
      parts/skill_model.js parts/spread.js parts/spread_plot.js parts/standard.js parts/standard_form.js
      parts/standard_target.js parts/status.js`,
  };
  const ROOT = new URL('.', document.currentScript.src).pathname; // Of this version's files.
  const LANGUAGES = ['en', 'de'];
  // As texts.js chooses: were it not the same, a file would come in vain.
  const wanted = [chosen(), ...navigator.languages.map(one => one.split('-')[0].toLowerCase()), 'en'];
  const words = `texts/${wanted.find(one => LANGUAGES.includes(one))}.js`;
  const [first, second, third] = location.pathname.split('/').filter(Boolean);
  const page = third ? null : !first ? 'today' : second && { sessions: 'session', trainees: 'trainee', tasks: 'task' }[first];
  for (const name of [words, ...(MODULES[page]?.trim().split(/\s+/) ?? [])])
    document.head.append(Object.assign(document.createElement('link'), { rel: 'modulepreload', href: ROOT + name }));

  function chosen() {
    try {
      return localStorage.getItem('trocar.language');
    } catch {
      return null; // Storage is refused (private window): the browser's languages stand.
    }
  }
})();
