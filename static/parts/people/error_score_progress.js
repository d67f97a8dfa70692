// The error score over a trainee's sessions of a task. Sessions without a score are gaps with their reason, never zeros.
import { html } from '../../preact.js';
import { calendarDay } from '../../format.js';
import { t } from '../../texts.js';
import { noErrorScoreText } from '../../translate.js';
import { ProgressPlot } from '../charts/progress_plot.js';

const words = t.errors;

/** The points of all versions in the order of the sessions, each with its version. @param {Schemas['TraineeProgressResponse']} progress */
const allPoints = ({ error_scores: scores }) =>
  scores.flatMap(one => one.points.map(point => ({ ...point, formula: one.formula }))).sort((a, b) => a.session - b.session);

/** Nothing is shown where no formula scores the sessions. @param {Props} props */
export function ErrorScoreProgress({ progress }) {
  const points = allPoints(progress);
  if (!points.length) return null;
  const scored = points.filter(point => point.value !== null);
  const changes = points.filter((point, i) => i > 0 && point.formula !== points[i - 1].formula)
    .map(point => ({ session: point.session, label: words.fromVersion(point.formula) }));
  const gaps = points.flatMap(({ session, none }) => (none ? [{ session, label: noErrorScoreText(none) }] : []));
  const reasons = [...new Map(gaps.map(gap => [gap.label, gaps.filter(one => one.label === gap.label).length]))];
  const series = { title: words.score, unit: '1', target: null, learning: { curve: null }, points };
  return html`
    <section class="card error-scores">
      <header><h2>${words.score}</h2></header>
      <div class="body stack tight">
        <p class="small muted">${words.scoreLead} ${versionsText(progress)}</p>
        ${scored.length > 0 && html`<${ProgressPlot} series=${series} sessions=${progress.sessions} gaps=${gaps} changes=${changes} plain />`}
        ${changes.length > 0 && html`<p class="small muted">${words.versionsDiffer}</p>`}
        ${reasons.length > 0 && html`<div class="small"><p>${scored.length ? words.gaps(gaps.length) : words.noScores}</p>
          <ul>${reasons.map(([label, n]) => html`<li key=${label}>${words.gapReason(n, label)}</li>`)}</ul></div>`}
      </div>
    </section>`;
}

/** `Version 1 of the formula. Version 2, for sessions that arrive from 1 May 2026 on.` */
const versionsText = ({ error_scores: scores }) =>
  scores.map(one => words.byVersion(one.formula, one.valid_from && calendarDay(one.valid_from))).join(' ');

/** Heading of the columns of the score in a table for a spreadsheet; none without a formula. */
export const scoreHeading = ({ error_scores: scores }) => (scores.length
  ? [words.score, `${words.score}: ${t.saveTable.low}`, `${words.score}: ${t.saveTable.high}`, words.scoreVersion, words.whyNoScore] : []);

/** These columns for each session, by its number. A missing score is an empty cell. */
export function scoreCells(progress) {
  if (!progress.error_scores.length) return () => [];
  const bySession = new Map(allPoints(progress).map(point => [point.session, point]));
  return session => {
    const point = bySession.get(session);
    return [point?.value, point?.low, point?.high, point?.formula, point ? point.none && noErrorScoreText(point.none)
      : noErrorScoreText({ reason: 'not_valid_yet', detail: words.notValidYet })];
  };
}
