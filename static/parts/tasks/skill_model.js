// A task's skill model: its accuracy, and the button that administrators train the next one with.
import { html, useState } from '../../preact.js';
import { api } from '../../api.js';
import { asProblem, useData } from '../../data.js';
import { date, percent } from '../../format.js';
import { t } from '../../texts.js';
import { ProblemNotice } from '../page/notice.js';

const words = t.tasks.model;
const wholePercent = share => percent(Math.round(100 * share) / 100);

/** @param {Props} props */
export function SkillModel({ task, mayTrain }) {
  const { data, reload } = useData(signal => api.tasks.models(task.id, signal), [task.id]);
  const [busy, setBusy] = useState(false);
  const [problem, setProblem] = useState(null);
  const train = async () => {
    setBusy(true);
    setProblem(null);
    await api.tasks.train(task.id).then(reload, error => setProblem(asProblem(error)));
    setBusy(false);
  };
  return html`
    <span class="small muted">${modelText(data?.items?.[0])}</span>
    ${mayTrain && html` <button class="button small" type="button" disabled=${busy} aria-label=${words.trainFor(task.name)}
      onClick=${train}>${busy ? words.busy : words.train}</button>`}
    <${ProblemNotice} problem=${problem} onDismiss=${() => setProblem(null)} />`;
}

function modelText(model) {
  if (!model) return words.none;
  if (model.withdrawn_at) return words.withdrawn(model.version, date(model.withdrawn_at));
  const { knows, accuracy: { value, low, high, people } } = model.report;
  return knows ? words.knows(model.version, wholePercent(value), wholePercent(low), wholePercent(high), people) : words.nothing(model.version);
}
