// Instructors' rating forms: filled in blind, then shown beside the others'. Trainees see the ratings that they got.
import { html, useId, useRef, useState } from '../../preact.js';
import { api } from '../../api.js';
import { asProblem, useData } from '../../data.js';
import { dateTime } from '../../format.js';
import { may } from '../../roles.js';
import { t } from '../../texts.js';
import { anchorText, formTitle, ratingItemSource, ratingItemTitle } from '../../translate.js';
import { ProblemNotice } from '../page/notice.js';

const words = t.session.ratings;

/** @param {Props} props */
export function Ratings({ session, person, onRated }) {
  const { data: base } = useData(
    async signal => {
      const [forms, task] = await Promise.all([api.ratingForms(signal), api.tasks.get(session.task.id, signal)]);
      return { forms, used: task.rating_forms };
    },
    [session.task.id],
  );
  const { data, problem, reload } = useData(signal => api.sessions.ratings(session.id, signal), [session.id]);
  const [open, setOpen] = useState(null);
  const handleRated = () => (setOpen(null), reload(), onRated());
  return html`
    <section class="card">
      <header><h2>${words.title}</h2></header>
      <div class="body stack">
        <${ProblemNotice} problem=${problem} onRetry=${reload} />
        ${data?.items.length === 0 && !may(person, 'rate') && html`<p class="muted">${words.empty}</p>`}
        ${base && data && base.forms.map(form => html`<${RatingsOfForm} key=${form.form} form=${form} ratings=${data} person=${person}
          session=${session} mayRate=${may(person, 'rate') && base.used.includes(form.form)} open=${open === form.form} onOpen=${() => setOpen(open === form.form ? null : form.form)}
          onRated=${handleRated} />`)}
      </div>
    </section>`;
}

/** @param {Props} props */
function RatingsOfForm({ form, ratings, mayRate, session, open, onOpen, onRated }) {
  const given = ratings.items.filter(rating => rating.form === form.form);
  const raters = ratings.raters.find(row => row.form === form.form)?.raters ?? 0;
  const own = given.find(rating => rating.own);
  if (!mayRate && !given.length) return null;
  return html`
    <section class="stack tight" aria-label=${formTitle(form)}>
      <div class="row apart">
        <h3>${formTitle(form)}</h3>
        ${mayRate && html`<button class="button" type="button" aria-expanded=${open} onClick=${onOpen}>${own
          ? words.again : words.rate}</button>`}
      </div>
      ${mayRate && html`<p class="small muted">${words.stands(Boolean(own), raters)}</p>`}
      ${given.length > 0 && html`<${Given} form=${form} given=${given} />`}
      ${open && html`<${RatingForm} form=${form} session=${session} onRated=${onRated} onCancel=${onOpen} />`}
    </section>`;
}

/** One column for each rater, one row for each item. @param {Props} props */
const Given = ({ form, given }) => html`
  <div class="scroll" tabindex="0" role="region" aria-label=${formTitle(form)}>
    <table class="table dense">
      <thead><tr><th scope="col">${words.item}</th>${given.map(rating => html`<th key=${rating.id} scope="col" class="number"
        title=${dateTime(rating.created_at)}>${raterName(rating)}</th>`)}</tr></thead>
      <tbody>
        ${form.items.map(item => html`<tr key=${item.name}><th scope="row">${ratingItemTitle(item)}</th>
          ${given.map(rating => html`<td key=${rating.id} class="number">${markText(rating, item)}</td>`)}
        </tr>`)}
        <tr><th scope="row">${words.total}</th>${given.map(rating => html`
          <td key=${rating.id} class="number"><strong>${totalText(rating)}</strong></td>`)}</tr>
      </tbody>
    </table>
  </div>
  ${differInItems(given) && html`<p class="small muted">${words.otherItems}</p>`}
  ${given.filter(rating => rating.remark).map(rating => html`<div key=${rating.id}>
    <p class="said">${rating.remark}</p><p class="small muted">${words.remarkOf(raterName(rating))}</p></div>`)}`;

const raterName = rating => (rating.own ? words.you : (rating.who ?? words.gone));

function markText(rating, item) {
  const given = rating.items.find(mark => mark.item === item.name);
  return given?.mark ?? (given?.does_not_apply ? words.doesNotApply : words.notJudged);
}

/** `23 of 25`. The maximum is that of the items that apply. @param {Schemas['RatingResponse']} rating */
export const totalText = ({ applicable_total: total }) => (total ? words.totalOf(total.sum, total.out_of) : words.noTotal);

/** Whether these ratings judged different items: their totals are then not compared. */
const differInItems = given =>
  new Set(given.map(rating => rating.items.filter(mark => !mark.does_not_apply).map(mark => mark.item).join())).size > 1;

const NOT_APPLICABLE = 'not-applicable';
/** The values of the radio buttons that give no mark. */
const WITHOUT_MARK = ['none', NOT_APPLICABLE];

/** @param {Props} props */
function RatingForm({ form, session, onRated, onCancel }) {
  const [busy, setBusy] = useState(false);
  const [problem, setProblem] = useState(null);
  const formElement = useRef(null);
  const id = useId();
  const save = async event => {
    event.preventDefault();
    const data = new FormData(formElement.current);
    const mark = ({ name }) => (WITHOUT_MARK.includes(String(data.get(name))) ? null : Number(data.get(name)));
    setBusy(true);
    setProblem(null);
    try {
      const items = Object.fromEntries(form.items.map(item => [item.name, mark(item)]));
      const left = form.items.map(({ name }) => name).filter(name => data.get(name) === NOT_APPLICABLE);
      const remark = String(data.get('remark')).trim() || null;
      await api.sessions.rate(session.id, { form: form.form, version: form.version, items, does_not_apply: left, remark });
      return onRated();
    } catch (error) {
      setProblem(asProblem(error));
    }
    setBusy(false);
  };
  return html`
    <form class="stack rating" ref=${formElement} onSubmit=${save}>
      <p class="small muted">${words.blind}</p>
      ${form.items.map(item => html`<${Item} key=${item.name} item=${item} form=${form} id=${`${id}-${item.name}`} />`)}
      <div class="field"><label for=${`${id}-remark`}>${words.remark}</label>
        <textarea id=${`${id}-remark`} name="remark" maxlength="2000"></textarea></div>
      <${ProblemNotice} problem=${problem} onDismiss=${() => setProblem(null)} />
      <p class="small muted">${form.is_published ? words.source(form.source) : words.ownForm}</p>
      <div class="row">
        <button class="button main" type="submit" disabled=${busy}>${busy ? t.form.saving : words.give}</button>
        <button class="button" type="button" onClick=${onCancel}>${t.form.cancel}</button>
      </div>
    </form>`;
}

/**
 * Radio buttons: arrow keys move between the marks; a text explains a mark if the form has one for it.
 *
 * @param {Props} props
 */
function Item({ item, form, id }) {
  const marks = Array.from({ length: form.most - form.least + 1 }, (_, index) => form.least + index);
  const [meaning, setMeaning] = useState(null);
  const hasAnchor = mark => item.anchors.some(anchor => anchor.mark === mark);
  return html`
    <fieldset class="plain mark-of" aria-describedby=${id}>
      <legend>${ratingItemTitle(item)}${item.source && html` <span class="small muted">(${ratingItemSource(item)})</span>`}</legend>
      <div class="row marks">
        ${marks.map(mark => html`<label key=${mark} class="mark-choice"><input type="radio" name=${item.name} value=${mark}
          required onChange=${() => setMeaning(mark)} /><span>${mark}</span></label>`)}
        <label class="mark-choice"><input type="radio" name=${item.name} value="none" onChange=${() => setMeaning(null)} />
          <span>${words.notJudged}</span></label>
        <label class="mark-choice"><input type="radio" name=${item.name} value=${NOT_APPLICABLE} onChange=${() => setMeaning(null)} />
          <span>${words.doesNotApply}</span></label>
      </div>
      <ul id=${id} class="small muted anchors">
        ${item.anchors.map(({ mark }, index) => html`<li key=${mark} class=${mark === meaning ? 'chosen' : ''}>${
          words.anchor(mark, anchorText(item, index))}</li>`)}
        ${meaning && !hasAnchor(meaning) && html`<li class="chosen">${words.between(meaning)}</li>`}
      </ul>
    </fieldset>`;
}
