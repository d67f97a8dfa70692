// What people said of a session, for its printed report: ratings with totals and remarks, comments, and advice.
import { html } from '../../preact.js';
import { api } from '../../api.js';
import { clock, date } from '../../format.js';
import { t } from '../../texts.js';
import { adviceText, formTitle } from '../../translate.js';
import { totalText } from './ratings.js';

const words = t.report;
const MAX_COMMENTS = 12; // The sheet says how many are left out.
const LETTERS_PER_LINE = 110;
/** The heights of a heading and of the picture of a curve are about those of so many lines. */
const HEADING_LINES = 2;

/**
 * What the reader may see of it; the report works without.
 *
 * @param {string} id @param {AbortSignal} [signal]
 */
export async function loadFeedback(id, signal) {
  const [forms, ratings, comments, advice] = await Promise.all([
    api.ratingForms(signal).catch(() => []), api.sessions.ratings(id, signal).catch(() => null),
    api.sessions.comments(id, signal).catch(() => null), api.sessions.advice(id, signal).catch(() => null)]);
  return { forms, ratings: ratings?.items ?? [], comments: comments?.items ?? [], hidden: comments?.hidden ?? 0, advice: advice?.items ?? [] };
}

/** @typedef {Awaited<ReturnType<typeof loadFeedback>>} ReportFeedbackData */

const linesOf = text => Math.ceil(text.length / LETTERS_PER_LINE) + (text.match(/\n/g)?.length ?? 0);

/** How many lines of the sheet it takes. @param {ReportFeedbackData} feedback */
export function feedbackLines({ ratings, comments, advice }) {
  const texts = [...ratings.map(one => one.remark ?? ''), ...comments.slice(0, MAX_COMMENTS).map(one => one.text), ...advice.map(adviceText)];
  const headings = [ratings, comments, advice].filter(list => list.length).length;
  return HEADING_LINES * headings + ratings.length + texts.reduce((sum, text) => sum + linesOf(text), 0);
}

/** @param {{ feedback: ReportFeedbackData }} props */
export function ReportFeedback({ feedback: { forms, ratings, comments, hidden, advice } }) {
  const titleOf = name => formTitle(forms.find(form => form.form === name) ?? { form: name, title: name });
  const further = comments.length - MAX_COMMENTS;
  return html`
    ${advice.length > 0 && html`<section><h2>${t.session.advice.title}</h2>
      <ul>${advice.map(item => html`<li key=${`${item.feature} ${item.tool}`}>${adviceText(item)}</li>`)}</ul></section>`}
    ${ratings.length > 0 && html`<section><h2>${t.session.ratings.title}</h2>
      <table class="ratings"><tbody>${ratings.map(rating => html`
        <tr key=${rating.id}><th scope="row">${rating.who ?? t.session.ratings.gone}</th><td>${titleOf(rating.form)}</td>
          <td>${date(rating.created_at)}</td><td><strong>${totalText(rating)}</strong>${leftOut(rating)}</td></tr>
        ${rating.remark && html`<tr key=${`${rating.id} remark`}><td colspan="4" class="said">${rating.remark}</td></tr>`}`)}</tbody></table></section>`}
    ${(comments.length > 0 || hidden > 0) && html`<section><h2>${t.session.comments.title}</h2>
      <ul class="said-list">${comments.slice(0, MAX_COMMENTS).map(comment => html`<li key=${comment.id}><strong>${span(comment)}</strong> <span
        class="said">${comment.text}</span> <span class="muted">(${comment.who ?? t.session.comments.gone})</span></li>`)}</ul>
      ${further > 0 && html`<p>${words.furtherComments(further)}</p>`}
      ${hidden > 0 && html`<p>${t.session.comments.hidden(hidden)}</p>`}</section>`}`;
}

const span = ({ from_s: from, to_s: to }) => (to > from ? `${clock(from)}–${clock(to)}` : clock(from));

/** How many items do not apply, so that two totals are not taken for the same. @param {Schemas['RatingResponse']} rating */
function leftOut(rating) {
  const left = rating.items.filter(mark => mark.does_not_apply).length;
  return left > 0 ? ` (${words.itemsLeftOut(left)})` : '';
}
