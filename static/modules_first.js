// Preloads the texts and a page's modules before the first of them is parsed: on a slow connection each level of
// imports costs a round trip. A classic script, so that it runs while the page is parsed;
// tests/browser/loading.test.mjs compares its lists with the imports.
(() => {
  const MODULES = {
    today: `
      format.js pages/today.js parts/courses/course_state.js parts/courses/own_courses.js parts/forms/dialog.js
      parts/guide/first_steps.js parts/guide/guide_state.js parts/page/recorded_at.js parts/page/status.js
      parts/people/attention.js parts/people/consent.js parts/people/trainee_home.js parts/session/compared_space.js
      parts/session/evidence.js parts/session/feature_notes.js parts/session/outcome_card.js with_error.js`,
    session: `
      format.js pages/session.js parts/forms/dialog.js parts/live/interrupted.js parts/live/light.js
      parts/live/live_screen.js parts/live/live_space.js parts/live/live_tools.js parts/live/live_track.js
      parts/live/live_view.js parts/live/placement.js parts/page/recorded_at.js parts/page/status.js
      parts/people/consent.js parts/playback/chunk_loader.js parts/playback/curves.js parts/playback/orbit.js
      parts/playback/overlay.js parts/playback/path3d.js parts/playback/playback.js parts/playback/player.js
      parts/playback/plots.js parts/playback/readouts.js parts/playback/space_painter.js parts/playback/track.js
      parts/recording/recording_target.js parts/session/advice.js parts/session/background.js
      parts/session/box_question.js parts/session/cohort_places.js parts/session/comments.js
      parts/session/compared_space.js parts/session/cuts.js parts/session/edit_dialog.js parts/session/edits.js
      parts/session/error_score.js parts/session/error_sheet.js parts/session/error_sheets.js
      parts/session/evidence.js parts/session/feature_folds.js parts/session/feature_notes.js
      parts/session/features.js parts/session/ghost.js parts/session/moves.js parts/session/outcome_card.js
      parts/session/quality.js parts/session/ratings.js parts/session/review.js parts/session/setup_versions.js
      parts/session/skill.js parts/session/span_bar.js parts/session/verdict.js parts/tasks/hand_choice.js watch.js
      with_error.js`,
    trainee: `
      csv.js format.js pages/trainee.js parts/charts/axis.js parts/charts/monitor_chart.js
      parts/charts/progress_plot.js parts/courses/course_state.js parts/courses/own_courses.js
      parts/exams/attempts.js parts/exams/exam_list.js parts/forms/dialog.js parts/page/recorded_at.js parts/page/save_table.js
      parts/page/status.js parts/people/access_entries.js parts/people/certificates.js parts/people/consent.js
      parts/people/error_score_progress.js parts/people/own_data.js parts/people/progress_summary.js
      parts/people/record_merges.js parts/people/retention.js parts/people/strengths.js
      parts/tasks/hand_choice.js parts/tasks/space_choice.js parts/tasks/standard.js with_error.js`,
    task: `
      format.js pages/task.js parts/charts/axis.js parts/charts/spread_plot.js parts/forms/dialog.js
      parts/forms/focus.js parts/page/status.js parts/session/error_score.js parts/tasks/error_list_form.js
      parts/tasks/errors.js parts/tasks/hand_choice.js parts/tasks/raters.js parts/tasks/rescorings.js
      parts/tasks/score_formula_form.js parts/tasks/skill_model.js parts/tasks/space_choice.js parts/tasks/spread.js
      parts/tasks/standard.js parts/tasks/standard_effect.js parts/tasks/standard_form.js
      parts/tasks/standard_target.js with_error.js`,
  };
  const ROOT = new URL('.', /** @type {HTMLScriptElement} */ (document.currentScript).src).pathname; // The folder of this version's files.
  const LANGUAGES = ['en', 'de'];
  // Same choice as in texts.js: otherwise a file would be loaded for nothing.
  const candidates = [storedLanguage(), ...navigator.languages.map(language => language.split('-')[0].toLowerCase()), 'en'];
  const textFile = `texts/${candidates.find(language => language && LANGUAGES.includes(language))}.js`;
  const basePath = document.documentElement.dataset.basePath ?? '';
  const [first, second, third] = location.pathname.slice(basePath.length).split('/').filter(Boolean);
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
