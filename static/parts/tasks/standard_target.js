// One target of a standard that is being set: its feature, and how its limit is determined.
import { html } from '../../preact.js';
import { number, unit } from '../../format.js';
import { t } from '../../texts.js';
import { exerciseTitle, featureTitle } from '../../translate.js';
import { Field } from '../forms/form.js';
import { handChoices, handOrTool, handOrToolQuery } from './hand_choice.js';
import { spaceChoices } from './space_choice.js';

const words = t.standardForm;
const PEOPLE_METHODS = ['trimmed_experts', 'contrasting_groups', 'best_share'];
let lastKey = 0;

const EMPTY = { feature: 'duration', holder: '', space: '3d', method: 'fixed', limit: '', preset: '', experts: '', novices: '', cohort: '', share: '25' };
const makeTarget = more => ({ ...EMPTY, key: (lastKey += 1), ...more });

/**
 * The targets that a form begins with: those in use, with a limit that was chosen elsewhere on the page in place of the
 * same target's.
 */
export function initialTargets(first, data, mayMake) {
  const inUse = (data.standards[0]?.targets ?? []).map(target => editableTarget(target, data, mayMake));
  if (first) return withChosenLimit(inUse, first);
  return inUse.length ? inUse : [newTarget(data)];
}

/**
 * The targets with a limit that was chosen elsewhere: it replaces the target of the same feature, hand and space, or is
 * added.
 */
export function withChosenLimit(targets, { feature, holder, space, limit }) {
  const chosen = makeTarget({ feature, holder, space, limit: String(Number(limit.toPrecision(6))) });
  const at = targets.findIndex(one => isSameTarget(one, chosen));
  return at < 0 ? [...targets, chosen] : targets.map((one, i) => (i === at ? chosen : one));
}

export const isSameTarget = (target, { feature, holder, space }) =>
  target.feature === feature && target.holder === holder && target.space === space;

/** One more target; the first one is usually a published time. */
export const newTarget = ({ standards, presets }) =>
  makeTarget({ preset: presets[0]?.preset ?? '', method: standards[0] || !presets.length ? 'fixed' : 'fls' });

/** A target in use, as it was made. The people behind its limit are not stored, so they are chosen again. */
function editableTarget({ feature, tool, in_hand, space, limit, basis }, { presets }, mayMake) {
  const common = { feature, holder: handOrTool({ tool, in_hand }), space, limit: String(limit) };
  const preset = presets.find(one => one.feature === feature && one.limit === limit)?.preset;
  if (basis.method === 'external' && preset) return makeTarget({ ...common, method: 'fls', preset });
  const usesPeople = mayMake && PEOPLE_METHODS.includes(basis.method);
  return makeTarget({ ...common, method: usesPeople ? basis.method : 'fixed', share: String(Math.round(100 * (basis.share ?? 0.25))) });
}

/** A target as the REST API takes it. */
export function targetRequest(target, features) {
  const feature = features.find(one => one.name === target.feature);
  const holder = feature?.of_tools ? handOrToolQuery(target.holder) : {};
  return { feature: target.feature, ...holder, space: target.space, by: limitRequest(target, feature) };
}

function limitRequest({ method, limit, preset, experts, novices, cohort, share }, feature) {
  if (method === 'fls') return { method, preset };
  if (method === 'trimmed_experts') return { method, experts };
  if (method === 'contrasting_groups') return { method, novices, experts };
  if (method === 'best_share') return { method, cohort, share: Number(share) / 100 };
  return { method, limit: Number(limit), unit: feature?.unit ?? '' };
}

/** The features that can have a limit: those where more or less is better. */
export const limitableFeatures = features => features.filter(feature => feature.better !== 'neither');

export function TargetFields({ target, data: { features, presets, cohorts }, mayMake, onChange }) {
  const feature = features.find(one => one.name === target.feature);
  const set = name => event => onChange({ [name]: event.target.value });
  const select = (name, label, options, required) => html`<${Field} type="select" label=${label} value=${target[name]} required=${required}
    options=${options} onInput=${set(name)} />`;
  const methods = Object.entries(words.methods).filter(([name]) =>
    (mayMake || !PEOPLE_METHODS.includes(name)) && (name !== 'fls' || (target.feature === 'duration' && presets.length > 0)));
  const { method } = target;
  const changeFeature = event => {
    const isTime = event.target.value === 'duration'; // Only times have published limits.
    const space = features.find(one => one.name === event.target.value)?.spaces[0];
    onChange({ feature: event.target.value, holder: '', space, ...(method === 'fls' && !isTime ? { method: 'fixed' } : {}) });
  };
  const choices = [['', t.target.choose], ...cohorts.map(one => [one.code, words.cohortOf(one.name, one.people)])];
  return html`
    <div class="fields">
      <${Field} type="select" label=${words.feature} value=${target.feature} onInput=${changeFeature}
        options=${limitableFeatures(features).map(one => [one.name, featureTitle(one)])} />
      ${feature?.of_tools && select('holder', words.hand, handChoices(feature, target.holder), !feature.of_session)}
      ${spaceChoices(feature).length > 0 && select('space', words.space, spaceChoices(feature), true)}
      ${select('method', words.method, methods, true)}
      ${method === 'fixed' && html`<${Field} type="number" step="any" required label=${words.limit(unit(feature?.unit))}
        value=${target.limit} onInput=${set('limit')} />`}
      ${method === 'fls' && select('preset', words.preset, presets.map(one => [one.preset,
        words.presetOf(exerciseTitle(one), number(one.limit), one.unit)]), true)}
      ${method === 'contrasting_groups' && select('novices', words.novices, choices, true)}
      ${['trimmed_experts', 'contrasting_groups'].includes(method) && select('experts', words.experts, choices, true)}
      ${method === 'best_share' && html`${select('cohort', words.cohort, choices, true)}<${Field} type="number" min="1" max="99" step="1"
        required label=${words.share} value=${target.share} onInput=${set('share')} />`}
      ${PEOPLE_METHODS.includes(method) && cohorts.length === 0 && html`<p class="muted wide">${words.noCohorts}</p>`}
    </div>`;
}
