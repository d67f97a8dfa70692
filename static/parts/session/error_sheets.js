// The errors of a session: the own sheet to fill in, the finished sheets of the raters, and the score that they give. Without a
// finished sheet a session is not rated, which is not the same as no errors.
import { html, useRef, useState } from '../../preact.js';
import { api } from '../../api.js';
import { asProblem, useData } from '../../data.js';
import { dateTime, number } from '../../format.js';
import { may } from '../../roles.js';
import { t } from '../../texts.js';
import { Notice, ProblemNotice } from '../page/notice.js';
import { ErrorScore } from './error_score.js';
import { ErrorSheetForm, MarkTime } from './error_sheet.js';

const words = t.errors;

/** How long before a mark playback begins, s: the rater marks an error after seeing it. */
const LEAD_S = 2;

/** On the page of a session. @param {Props} props */
export const ReviewedErrors = ({ session, person, playback }) => html`<${ErrorSheets} session=${session} person=${person}
  now=${() => playback.time} goTo=${at => playback.showInView(Math.max(0, at - LEAD_S), Math.max(0, at - LEAD_S))} />`;

/** While the recording arrives. @param {Props} props */
export const LiveErrors = ({ session, person, watch }) => html`<${ErrorSheets} session=${session} person=${person}
  now=${() => (watch.track?.frames ? watch.track.time : null)} goTo=${null} />`;

/** Nothing is shown where the task has no error items and the session no sheets. @param {Props} props */
function ErrorSheets({ session, person, now, goTo }) {
  const { data, problem, reload } = useData(
    signal => api.sessions.errorSheets(session.id, signal),
    [session.id, session.task.id, session.result, session.set_aside, session.voided, session.box_question],
  );
  const [refused, setRefused] = useState(null);
  const [finished, setFinished] = useState(false);
  const top = useRef(null);
  if (problem && !data) return html`<${ProblemNotice} problem=${problem} onRetry=${reload} />`;
  const hasList = Boolean(data?.list?.items.length);
  if (!data || (!hasList && !data.items.length && !data.open)) return null;
  const begin = () => api.sessions.beginErrorSheet(session.id).then(() => (setFinished(false), setRefused(null), reload()), error => setRefused(asProblem(error)));
  const done = () => (setFinished(true), top.current?.focus(), reload());
  const own = data.items.find(sheet => sheet.own && sheet.counts);
  return html`
    <section class="card errors">
      <header>
        <h2 ref=${top} tabindex="-1">${words.title}</h2>
        ${may(person, 'rate') && !data.open && (hasList || own) && html`<button class="button" type="button" onClick=${begin}>${
          own ? words.correct : words.begin}</button>`}
      </header>
      <div class="body stack">
        <${ProblemNotice} problem=${problem ?? refused} onRetry=${problem ? reload : undefined} onDismiss=${() => setRefused(null)} />
        ${finished && !data.open && own && html`<${Notice} tone="good" quiet title=${words.finished} />`}
        ${data.hidden > 0 && html`<p class="small muted">${words.hidden(data.hidden)}</p>`}
        ${data.open && html`<${ErrorSheetForm} key=${data.open.id} session=${session} sheet=${data.open} now=${now} goTo=${goTo} onDone=${done} />`}
        ${data.items.length > 0 && html`<${FinishedSheets} sheets=${data.items} goTo=${goTo} />`}
        ${!data.open && !data.hidden && session.status !== 'receiving' && html`<${ErrorScore} answer=${data.score} />`}
        ${!data.items.length && !data.hidden && !data.open && data.score.none?.reason !== 'no_sheet' && html`<p class="muted">${words.notRated}</p>`}
      </div>
    </section>`;
}

/** One column for each rater, one row for each item; below, where each error was seen. @param {Props} props */
function FinishedSheets({ sheets, goTo }) {
  const items = [...new Map(sheets.flatMap(sheet => sheet.items).map(item => [item.item, item])).values()];
  const marks = sheets.flatMap(sheet => sheet.marks.map(mark => ({ ...mark, sheet })));
  const named = mark => mark.sheet.items.find(item => item.item === mark.item)?.name ?? mark.item;
  return html`
    <div class="scroll" tabindex="0" role="region" aria-label=${words.sheets}>
      <table class="table dense">
        <thead><tr><th scope="col">${words.item}</th>${sheets.map(sheet => html`<th key=${sheet.id} scope="col" class="number"
          title=${dateTime(sheet.finished_at)}>${raterName(sheet)}${!sheet.counts && html`<small>${words.ofTask(sheet.task)}</small>`}</th>`)}</tr></thead>
        <tbody>
          ${items.map(item => html`<tr key=${item.item}><th scope="row">${item.name}</th>
            ${sheets.map(sheet => html`<td key=${sheet.id} class="number">${valueText(sheet, item)}</td>`)}</tr>`)}
          ${sheets.some(sheet => sheet.time_s !== null) && html`<tr><th scope="row">${words.timeByHand}</th>
            ${sheets.map(sheet => html`<td key=${sheet.id} class="number">${number(sheet.time_s)}</td>`)}</tr>`}
        </tbody>
      </table>
    </div>
    ${marks.length > 0 && html`<details><summary>${words.moments(marks.length)}</summary>
      <ul class="error-marks">${marks.sort((a, b) => (a.at_s ?? Infinity) - (b.at_s ?? Infinity)).map(mark => html`
        <li key=${mark.id}><${MarkTime} mark=${mark} goTo=${goTo} /><span>${named(mark)}</span>
          <span class="small muted">${sheets.length > 1 ? raterName(mark.sheet) : ''}</span></li>`)}</ul></details>`}`;
}

const raterName = sheet => (sheet.own ? t.session.ratings.you : (sheet.who ?? t.session.ratings.gone));

/** What a sheet says of an item: the number, the amount with its unit, yes or no. */
function valueText(sheet, item) {
  const found = sheet.values.find(one => one.item === item.item);
  if (!found) return '–';
  if (found.value === null) return words.notTyped;
  if (item.kind === 'yes_no') return words.yesNo[found.value];
  return [number(found.value), item.unit].filter(Boolean).join(' ');
}
