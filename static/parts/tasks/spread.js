// How people's values of a feature are distributed, one dot per person, with a movable limit. The service says how many
// people the limit would judge wrongly.
import { html, useEffect, useState } from '../../preact.js';
import { api } from '../../api.js';
import { useData } from '../../data.js';
import { percent, unit } from '../../format.js';
import { t } from '../../texts.js';
import { featureTitle, reasonText } from '../../translate.js';
import { Field } from '../forms/form.js';
import { Empty, Loading, ProblemNotice } from '../page/notice.js';
import { SpreadPlot } from '../charts/spread_plot.js';
import { standardInUse } from './standard.js';
import { spaceChoices, spaceOf } from './space_choice.js';
import { handChoices, handOrTool, handOrToolQuery, needsPreference } from './hand_choice.js';
import { limitableFeatures } from './standard_target.js';

const words = t.spread;
const STEPS = 200;
const WAIT_MS = 250; // Between the last move of the limit and the request for its effect.

export function Spread({ data: { task, standards, features, cohorts }, onTake }) {
  const inUse = standardInUse(standards);
  const target = inUse?.targets[0];
  const [selection, setSelection] = useState({ feature: target?.feature ?? 'duration', holder: target ? handOrTool(target) : '', space: target?.space ?? '3d', hand: target?.made_from?.handedness ?? 'right',
    first: '', second: '' });
  const [movedLimit, setMovedLimit] = useState(null);
  const feature = features.find(one => one.name === selection.feature);
  const holder = feature?.of_tools ? selection.holder : '';
  const hand = needsPreference(holder) ? selection.hand : undefined;
  const space = spaceOf(feature, selection.space);
  const known = targetOf(inUse, { ...selection, holder, space });
  const limit = movedLimit ?? known?.limit ?? null;
  const settled = useSettled(limit);
  const isReady = !feature || feature.of_session || holder !== '';
  const groups = [selection.first, selection.second].filter(Boolean).join(',');
  const { data, current, problem, reload } = useData(
    signal => isReady ? api.tasks.distribution(task.id, { feature: selection.feature, ...handOrToolQuery(holder), space, cohorts: groups, hand, limit: settled }, signal) : null,
    [task.id, selection.feature, holder, space, groups, hand, settled, isReady]);
  const set = name => event => {
    setSelection({ ...selection, [name]: event.target.value });
    if (name === 'feature' || name === 'holder' || name === 'space') setMovedLimit(null);
  };
  const people = [['', words.everybody], ...cohorts.map(one => [one.code, t.standardForm.cohortOf(one.name, one.people)])];
  const shown = data && data.feature === selection.feature && handOrTool(data) === holder && data.space === space ? data : null;
  return html`
    <section class="card">
      <header><h2>${words.title}</h2></header>
      <div class="filters">
        <${Field} type="select" label=${words.feature} value=${selection.feature} onInput=${set('feature')}
          options=${limitableFeatures(features).map(one => [one.name, featureTitle(one)])} />
        ${feature?.of_tools && html`<${Field} type="select" label=${t.standardForm.hand} value=${holder} onInput=${set('holder')}
          options=${handChoices(feature, holder)} />`}
        ${spaceChoices(feature).length > 0 && html`<${Field} type="select" label=${t.standardForm.space} value=${space} onInput=${set('space')}
          options=${spaceChoices(feature)} />`}
        ${needsPreference(holder) && html`<${Field} type="select" label=${words.hand} value=${selection.hand} onInput=${set('hand')}
          options=${Object.entries(t.trainees.hands)} />`}
        ${cohorts.length > 0 && html`<${Field} type="select" label=${words.first} value=${selection.first} options=${people} onInput=${set('first')} />
          <${Field} type="select" label=${words.second} value=${selection.second} onInput=${set('second')}
            options=${[['', words.nobody], ...people.slice(1)]} />`}
      </div>
      <div class="body stack">
        <p class="small muted">${words.lead}</p>
        <${ProblemNotice} problem=${problem} onRetry=${reload} />
        ${isReady && !shown && !problem && html`<${Loading} />`}
        ${shown && html`<${DistributionView} distribution=${shown} isFresh=${shown === current && limit === settled} limit=${limit} known=${known?.limit} isNovices=${selection.first !== ''} onMove=${setMovedLimit}
          onTake=${onTake && (() => onTake({ feature: selection.feature, holder, space, limit }))} />`}
      </div>
    </section>`;
}

const targetOf = (standard, { feature, holder, space }) =>
  standard?.targets.find(one => one.feature === feature && handOrTool(one) === holder && one.space === space);

/** The value after it has not changed for a moment. */
function useSettled(value) {
  const [settled, setSettled] = useState(value);
  useEffect(() => {
    const timer = setTimeout(() => setSettled(value), WAIT_MS);
    return () => clearTimeout(timer);
  }, [value]);
  return settled;
}

/**
 * `isFresh`: whether `distribution` belongs to this limit. Meanwhile the dots stay, but shares of another limit are not
 * shown.
 *
 * @param {Props} props
 */
function DistributionView({ distribution, isFresh, limit, known, isNovices, onMove, onTake }) {
  const values = distribution.groups.flatMap(group => group.values);
  if (!values.length) return html`<${Empty} title=${words.none} body=${words.noneBody} />`;
  const [low, high, step] = sliderRange(values, known, limit);
  const move = event => event.target.value !== '' && onMove(Number(event.target.value));
  return html`
    <${SpreadPlot} distribution=${distribution} limit=${limit} range=${[low, high]} />
    <div class="slide">
      <div class="field"><label for="spread-slide">${words.slide}</label>
        <input id="spread-slide" type="range" min=${low} max=${high} step=${step} value=${limit ?? (low + high) / 2}
          onInput=${move} /></div>
      <${Limit} name=${unit(distribution.unit)} limit=${limit} onMove=${move} />
      ${onTake && html`<button class="button" type="button" disabled=${limit === null} onClick=${onTake}>${words.take}</button>`}
    </div>
    <ul class="stack tight" aria-live="polite" aria-busy=${!isFresh}>
      ${limit === null ? html`<li class="muted">${words.noLimit}</li>`
        : distribution.groups.map((group, at) => html`<li key=${group.cohort}>${isFresh ? groupText(group, at, isNovices, distribution.groups.length) : `${nameOf(group)}: …`}</li>`)}
    </ul>`;
}

/** The number beside the slider. It follows the slider without losing what is being typed. */
function Limit({ name, limit, onMove }) {
  const [typed, setTyped] = useState(null);
  const shown = typed ?? (limit === null ? '' : String(Number(limit.toPrecision(4))));
  return html`
    <div class="field"><label for="spread-limit">${words.limit(name)}</label>
      <input id="spread-limit" type="number" step="any" value=${shown} onInput=${event => (setTyped(event.target.value), onMove(event))}
        onBlur=${() => setTyped(null)} /></div>`;
}

const nameOf = group => group.name ?? words.everybody;

function groupText(group, at, isNovices, count) {
  const name = nameOf(group);
  if (!group.keeping) return group.withheld ? words.withheld(name, reasonText(group.withheld)) : `${name}: …`;
  const share = estimate => words.seenOf(percent(estimate.seen), percent(estimate.low), percent(estimate.high), percent(estimate.expected));
  const isSecond = at === count - 1 && (count === 2 || !isNovices) && group.cohort !== null;
  if (isSecond) return words.falseFail(name, share(group.breaking));
  return group.cohort === null ? words.keeps(name, share(group.keeping)) : words.falsePass(name, share(group.keeping));
}

/**
 * The ends and step of the slider: a margin beyond the outermost values and the limit in use, rounded steps; a limit
 * that was typed beyond that is included.
 */
function sliderRange(values, known, limit) {
  const all = known === undefined ? values : [...values, known];
  const [low, high] = [Math.min(...all), Math.max(...all)];
  const margin = (high - low || Math.abs(high) || 1) * 0.15;
  const step = 10 ** Math.floor(Math.log10((high - low + 2 * margin) / STEPS));
  const round = (value, to) => Number((to(value / step) * step).toPrecision(12));
  return [round(Math.min(low - margin, limit ?? low), Math.floor), round(Math.max(high + margin, limit ?? high), Math.ceil), step];
}
