// What a page shows when it is empty, loading or has failed.
import { html } from '../../preact.js';
import { t } from '../../texts.js';
import { problemDetail, problemTitle } from '../../translate.js';
import { icons } from './icons.js';
import { ProblemDetail } from './prose.js';

/** A problem: what happened (title) and what to do (detail). */
export function ProblemNotice({ problem, onRetry, onDismiss }) {
  if (!problem) return null;
  return html`
    <div class="notice bad" role="alert">
      <${icons.warning} />
      <div>
        <strong>${problemTitle(problem)}</strong>
        ${problemDetail(problem).text && html`<p><${ProblemDetail} problem=${problem} /></p>`}
        ${onRetry && html`<p><button class="button" type="button" onClick=${onRetry}>${t.retry}</button></p>`}
      </div>
      ${onDismiss && html`<button class="button bare" type="button" aria-label=${t.problems.dismiss}
        onClick=${onDismiss}><${icons.close} /></button>`}
    </div>`;
}

const TONE_ICON = { good: icons.good, busy: icons.info, warn: icons.warning, bad: icons.warning };

/** A message that is not an error. Announced politely, except `quiet` ones, whose numbers change often. */
export const Notice = ({ tone = 'busy', title, quiet, children }) => {
  const Icon = TONE_ICON[tone];
  return html`
    <div class=${`notice ${tone}`} role=${quiet ? undefined : 'status'}>
      <${Icon} />
      <div><strong>${title}</strong>${children && html`<p>${children}</p>`}</div>
    </div>`;
};

/** An empty state says what would be here and offers the next step. */
export const Empty = ({ title, body, children }) => html`
  <div class="empty">
    <p class="title">${title}</p>
    <p>${body}</p>
    ${children}
  </div>`;

export const Loading = () => html`<div class="loading" role="status">${t.loading}</div>`;

/** Text for screen readers only, announced when it changes. */
export const Announce = ({ children }) => html`<div class="unseen" role="status" aria-live="polite">${children}</div>`;

/** The head of a page: its one h1, a sentence on its purpose, and its main actions. */
export const PageHead = ({ title, lead, children }) => {
  document.title = `${title} – ${t.product}`;
  return html`
    <div class="head">
      <div>
        <h1 tabindex="-1">${title}</h1>
        ${lead && html`<p>${lead}</p>`}
      </div>
      <div class="row">${children}</div>
    </div>`;
};
