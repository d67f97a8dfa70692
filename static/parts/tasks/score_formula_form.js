// Sets a task's score formula from named parts, and tries it on a session before.
import { html, useRef, useState } from '../../preact.js';
import { api } from '../../api.js';
import { asProblem, useData } from '../../data.js';
import { date, number } from '../../format.js';
import { t } from '../../texts.js';
import { Field } from '../forms/form.js';
import { ProblemNotice } from '../page/notice.js';
import { ErrorScore } from '../session/error_score.js';

const words = t.errors;
const today = () => new Date(Date.now() - new Date().getTimezoneOffset() * 60_000).toISOString().slice(0, 10);

/** `first`: the formula that the form begins with. @param {Props} props */
export function ScoreFormulaForm({ task, items, first, isExample, isFirst, onSet, onCancel }) {
  const form = useRef(null);
  const [problem, setProblem] = useState(null);
  const [busy, setBusy] = useState(false);
  const [isScaled, setScaled] = useState(first ? Boolean(first.scale) : true);
  const weightOf = item => first?.weights.find(weight => weight.item === item.item)?.weight ?? '';
  const save = async event => {
    event.preventDefault();
    setBusy(true);
    setProblem(null);
    try {
      return onSet(await api.tasks.setScoreFormula(task.id, formulaIn(form.current, items)));
    } catch (error) {
      setProblem(asProblem(error));
    }
    return setBusy(false);
  };
  const points = { type: 'number', min: '0.001', max: '1000000', step: 'any' };
  return html`
    <form class="stack" ref=${form} onSubmit=${save}>
      <p class="muted">${words.formulaLead}</p>
      ${isExample && html`<p class="muted">${words.exampleFormula}</p>`}
      <div class="fields">
        <${Field} ...${points} name="cut_off_s" label=${words.cutOffS} max="86400" required value=${first?.cut_off_s ?? ''} />
        <${Field} type="select" name="time" label=${words.time} value=${first?.time ?? 'measured'} options=${Object.entries(words.times)} />
        ${items.map(item => html`<${Field} key=${item.item} ...${points} name=${`weight ${item.item}`} label=${words.weightOf(item.name)}
          hint=${words.weightPer[item.kind](item.unit)} optional value=${weightOf(item)} />`)}
        <${Field} type="select" name="scaled" label=${words.scale} value=${isScaled ? 'yes' : 'no'} onInput=${event => setScaled(event.target.value === 'yes')}
          options=${[['yes', words.isScaled], ['no', words.notScaled]]} />
        ${isScaled && html`<${Field} ...${points} name="norm" label=${words.norm} hint=${words.normHint} required value=${first?.scale?.norm ?? ''} />
          <${Field} ...${points} name="maximum" label=${words.maximum} required value=${first?.scale?.maximum ?? 100} />`}
        <${Field} type="checks" name="limits" label=${words.limits} options=${[['not_below_zero', words.notBelowZero], ...(isScaled ? [['not_above', words.notAboveMaximum]] : [])]}
          value=${[(first?.not_below_zero ?? true) && 'not_below_zero', (first?.scale?.not_above ?? true) && 'not_above'].filter(Boolean)} />
        <${Field} type="date" name="valid_from" label=${words.validFromDay} hint=${isFirst ? words.validForAllHint : words.validFromHint}
          required=${!isFirst} optional=${isFirst} value=${isFirst ? '' : today()} />
        <${Field} name="note" label=${words.note} hint=${words.noteHint} optional wide maxlength="120" value=${first?.note ?? ''} />
      </div>
      <${Try} task=${task} formulaOf=${() => formulaIn(form.current, items)} isValid=${() => form.current.reportValidity()} />
      <${ProblemNotice} problem=${problem} />
      <div class="row">
        <button class="button main" type="submit" disabled=${busy}>${busy ? t.form.saving : words.saveFormula}</button>
        <button class="button" type="button" onClick=${onCancel}>${t.form.cancel}</button>
      </div>
    </form>`;
}

/** The formula that the form describes. An item without a weight is not subtracted. */
function formulaIn(form, items) {
  const data = new FormData(form);
  const value = name => Number(data.get(name));
  const limits = data.getAll('limits');
  const weights = items.filter(item => data.get(`weight ${item.item}`)).map(item => ({ item: item.item, weight: value(`weight ${item.item}`) }));
  const scale = data.get('scaled') === 'yes' ? { norm: value('norm'), maximum: value('maximum'), not_above: limits.includes('not_above') } : undefined;
  return {
    cut_off_s: value('cut_off_s'),
    time: /** @type {Schemas['ScoreTime']} */ (data.get('time')),
    weights,
    scale,
    not_below_zero: limits.includes('not_below_zero'),
    note: String(data.get('note') ?? '') || undefined,
    valid_from: String(data.get('valid_from') ?? '') || undefined,
  };
}

/** Tries the formula on one of the task's last sessions; nothing is stored. @param {Props} props */
function Try({ task, formulaOf, isValid }) {
  const { data: sessions } = useData(signal => api.sessions.page({ task: task.id, status: 'done', limit: 20 }, signal).then(page => page.items), [task.id]);
  const [chosen, setChosen] = useState('');
  const [tried, setTried] = useState(null);
  const [problem, setProblem] = useState(null);
  if (!sessions?.length) return html`<p class="small muted">${words.nothingToTry}</p>`;
  const shown = chosen || sessions[0].id;
  const run = async () => {
    if (!isValid()) return;
    setProblem(null);
    const formula = formulaOf();
    await api.tasks.tryScoreFormula(task.id, { formula, session: shown })
      .then(answer => setTried({ formula, answer }), error => (setTried(null), setProblem(asProblem(error))));
  };
  return html`
    <fieldset class="plain target stack tight" aria-live="polite">
      <legend class="label">${words.tryOn}</legend>
      <div class="row">
        <select class="select" aria-label=${words.trySession} value=${shown} onChange=${event => (setChosen(event.target.value), setTried(null))}>
          ${sessions.map(one => html`<option key=${one.id} value=${one.id} selected=${one.id === shown}>${one.trainee.name}, ${date(one.recorded_at)}${durationText(one)}</option>`)}
        </select>
        <button class="button" type="button" onClick=${run}>${words.try}</button>
      </div>
      <${ProblemNotice} problem=${problem} onDismiss=${() => setProblem(null)} />
      ${tried && html`<${ErrorScore} answer=${tried.answer} tried=${tried.formula} />`}
    </fieldset>`;
}

/** @param {Schemas['SessionResponse']} session */
const durationText = session => {
  const duration = session.features.find(one => one.name === 'duration' && one.tool === null)?.value;
  return duration ? `, ${number(duration)} s` : '';
};
