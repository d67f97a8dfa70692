// The features of a session: one row per feature, one column per tool, "not enough" in words instead of a number.
import { html, useState } from '../../preact.js';
import { number, unit } from '../../format.js';
import { t } from '../../texts.js';
import { featureTitle, noErrorBarText, notEnoughText, toolWithHand } from '../../translate.js';
import { Empty } from '../page/notice.js';
import { CohortChooser, CohortPlace } from './cohort_places.js';
import { featuresIn, firstSpace, isTooUncertain, PoorDepth } from './compared_space.js';
import { featureKey, Stretches } from './evidence.js';
import { featureParts, Fold, FoldAll, useFolds } from './feature_folds.js';
import { isUninformative, Meaning, valueNotes } from './feature_notes.js';
import { withError } from '../../with_error.js';

const words = t.session;

/**
 * One row per feature, in the order of the service: `{ name, title, family, unit, space, needsDepth, better, byTool: {
 * tool → feature } }`. All features of a name have one space; live features have none.
 */
export function featureRows(features) {
  const rows = new Map();
  for (const feature of features) {
    if (!rows.has(feature.name))
      rows.set(feature.name, {
        name: feature.name,
        title: featureTitle(feature),
        family: feature.family,
        unit: feature.unit,
        space: feature.space,
        needsDepth: feature.needs_depth,
        better: feature.better,
        byTool: new Map(),
      });
    rows.get(feature.name).byTool.set(feature.tool, feature);
  }
  return [...rows.values()];
}

/** @param {Props} props */
export function Features({ session, places, evidence, playback }) {
  const { features, live_features: live, tools } = session;
  const [open, setOpen] = useState(null);
  const [chosen, setChosen] = useState(null);
  const folds = useFolds();
  const space = chosen ?? firstSpace(session);
  const withheld = session.quality?.verdict === 'refused';
  if (withheld) return html`<${Empty} title=${words.withheld} body=${words.withheldBody} />`;
  if (!features?.length) return html`<${Empty} title=${words.noFeatures} body=${words.noFeaturesBody} />`;
  const rows = featureRows(featuresIn(features, space));
  const hasSessionFeatures = rows.some(row => row.byTool.has(null));
  const columns = [...tools, ...(hasSessionFeatures ? [null] : [])];
  const heads = new Map(tools.map(tool => [tool, toolWithHand(features, tool)]));
  const parts = featureParts(rows, space);
  const general = generalReasons(rows);
  const liveRows = new Map(space === '3d' ? featureRows(live ?? []).map(row => [row.name, row.byTool]) : []);
  const spaces = ['3d', 'image'].filter(name => features.some(feature => feature.space === name));
  /** Shows a feature's stretches and goes to the first, which contributed most. */
  const toggle = (row, first) => {
    setOpen(open === row.name ? null : row.name);
    if (open !== row.name && first) playback.show(first.from_s, first.to_s);
  };
  return html`
    ${spaces.length > 1 && html`
      <div class="row chooser" role="group" aria-label=${words.plane}>
        ${spaces.map(name => html`<button key=${name} class="button" type="button" aria-pressed=${space === name}
          onClick=${() => setChosen(name)}>${name === '3d' ? words.space3d : words.image}</button>`)}
      </div>`}
    <${PoorDepth} session=${session} />
    <${CohortChooser} places=${places} />
    ${liveRows.size > 0 && html`<p class="small muted chooser">${words.liveDiffers}</p>`}
    ${general.map(why => html`<p key=${why.text} class="small muted chooser" lang=${why.lang}>${why.text}</p>`)}
    <div class="row chooser fold-all"><${FoldAll} parts=${parts} folds=${folds} /></div>
    ${parts.map(part => html`<${Fold} key=${part.key} part=${part} folds=${folds}>
      <${PartTable} part=${part} columns=${columns} heads=${heads} general=${general} open=${open} toggle=${toggle} evidence=${evidence}
        playback=${playback} places=${places} liveRows=${liveRows} /><//>`)}`;
}

/** The table of one part. All parts have the same columns. @param {Props} props */
const PartTable = ({ part, columns, heads, ...of }) => html`
  <div class="scroll" tabindex="0" role="region" aria-label=${part.title}>
    <table class="table dense features">
      <thead>
        <tr>
          <th scope="col">${words.feature}</th>
          ${columns.map(tool => html`<th key=${tool} scope="col" class="number">${heads.get(tool) ?? words.both}</th>`)}
          <th scope="col" class="unit"><span class="unseen">${words.unit}</span></th>
        </tr>
      </thead>
      <tbody>${part.rows.map(row => html`<${Row} key=${row.name} row=${row} columns=${columns} ...${of} />`)}</tbody>
    </table>
  </div>`;

/** One feature; below it what is to be said about it, and the seconds that made it. @param {Props} props */
const Row = ({ row, columns, general, open, toggle, evidence, playback, places, liveRows }) => html`
  <tr>
    <th scope="row"><${Title} row=${row} evidence=${evidence} open=${open === row.name}
      onToggle=${stretch => toggle(row, stretch)} />${whyNot(row)
      .filter(why => !general.some(one => one.text === why.text))
      .map(why => html`<small key=${why.text} lang=${why.lang}>${why.text}</small>`)}</th>
    ${columns.map(tool => html`<td key=${tool} class=${`number ${isFaint(row.byTool.get(tool)) ? 'faint' : ''}`}><${Value}
      feature=${row.byTool.get(tool)} answer=${places.answer} /><${LiveValue} feature=${liveRows.get(row.name)?.get(tool)} /></td>`)}
    <td class="unit">${unit(row.unit)}</td>
  </tr>
  <tr class="about"><td colspan=${columns.length + 2}>
    ${valueNotes(row).map(note => html`<small key=${note} class="note">${note}</small>`)}<${LowerBound} row=${row} />
    <${Meaning} row=${row} /></td></tr>
  ${open === row.name && html`
    <tr key=${`${row.name} seconds`} class="seconds"><td colspan=${columns.length + 2}>
      ${columns.filter(tool => rowOf(evidence, row, tool)).map(tool => html`
        <div key=${tool} class="row seconds-row">${tool && html`<strong class="small">${tool}</strong>`}
          <${Stretches} row=${rowOf(evidence, row, tool)} playback=${playback} /></div>`)}
    </td></tr>`}`;

const isFaint = feature => Boolean(feature && isUninformative(feature));

const rowOf = (evidence, row, tool) => evidence?.get(featureKey(row.name, tool, row.space));

/** A feature with stretches is a button that shows them. @param {Props} props */
function Title({ row, evidence, open, onToggle }) {
  const rows = [...row.byTool.keys()].map(tool => rowOf(evidence, row, tool)).filter(Boolean);
  const withStretches = rows.filter(evidenceRow => evidenceRow.stretches.length);
  if (!rows.some(evidenceRow => evidenceRow.stretches.length || evidenceRow.none?.reason === 'nothing_stands_out')) return row.title;
  return html`<button class="feature-of" type="button" aria-expanded=${open}
    title=${withStretches.length ? words.evidence.show : words.evidence.none.nothing_stands_out}
    onClick=${() => onToggle(withStretches[0]?.stretches[0])}>${row.title}</button>`;
}

/** What a lower bound means. @param {Props} props */
const LowerBound = ({ row }) => [...row.byTool.values()].some(feature => feature.is_lower_bound) &&
  html`<small>${words.atLeastMeans}</small>`;

/**
 * Why values are missing, shown under the title, where there is space; the cell only says that there is no number. A
 * reason that holds for every tool names none.
 */
function whyNot(row) {
  const features = [...row.byTool.values()];
  const missing = features.filter(isMissing).map(feature => ({ tool: feature.tool, ...notEnoughText(feature) }));
  const isSame = features.length > 1 && missing.length === features.length && new Set(missing.map(one => one.text)).size === 1;
  if (isSame) return [missing[0]];
  return missing.map(({ tool, text, lang }) => ({ text: [tool, text].filter(Boolean).join(': '), lang }));
}

/** A reason of most rows, such as a tool that was never seen, is shown once above the table. */
function generalReasons(rows) {
  const counts = new Map();
  for (const why of rows.flatMap(whyNot)) counts.set(why.text, { why, count: (counts.get(why.text)?.count ?? 0) + 1 });
  return [...counts.values()].filter(({ count }) => count > rows.length / 2).map(({ why }) => why);
}

const isMissing = feature => feature.value === null || feature.value === undefined;

/** @param {Props} props */
function Value({ feature, answer }) {
  if (!feature) return '';
  if (feature.is_lower_bound) return html`<${AtLeast} feature=${feature} /><${Limit} feature=${feature} />`;
  if (isMissing(feature)) return html`<span class="not-enough">${words.notEnough}</span>`;
  const [value, half] = feature.error && !feature.no_error ? withError(feature.value, feature.error) : [number(feature.value)];
  return html`${value}<${Uncertainty} feature=${feature} half=${half} /><${TooUncertain} feature=${feature} /><${Limit} feature=${feature} /><${CohortPlace}
    feature=${feature} answer=${answer} />`;
}

/**
 * The uncertainty of the value: half of the range that holds 95 of 100 sessions. The ends of the range do not bound the
 * error.
 *
 * @param {Props} props
 */
function Uncertainty({ feature, half }) {
  const [error, why] = [feature.error, noErrorBarText(feature)];
  if (why) return html`<small class="off" title=${words.offUnknown(why)}>${words.off('?')}</small>`;
  if (!error) return '';
  const explanation = words.offMeans(number(error.low), number(error.high));
  return html`<small class="off" title=${explanation} aria-label=${explanation}>${words.off(half)}</small>`;
}

/**
 * That the error leaves nothing of a value, or that one which needs depth may be off by so much that it is not worth a
 * comparison.
 *
 * @param {Props} props
 */
const TooUncertain = ({ feature }) => {
  if (isUninformative(feature)) return html`<small class="says-nothing">${words.saysNothing}</small>`;
  return isTooUncertain(feature) && html`
    <small class="too-uncertain" title=${words.comparedSpace.tooUncertainMeans}>${words.comparedSpace.tooUncertain}</small>`;
};

/** A value that the recording shows only in part. @param {Props} props */
const AtLeast = ({ feature }) => html`<span title=${words.atLeastMeans}>${words.atLeast(number(feature.value))}</span>`;

/** The limit of the standard, and whether it was met. @param {Props} props */
const Limit = ({ feature: { target, judgement } }) => target && html`
  <small class=${`limit ${judgement}`}>${t.report.limits[target.better](number(target.limit))}<span class="unseen">: ${
    t.report.judgements[judgement ?? '']}</span></small>`;

/** The value shown while the recording arrived. @param {Props} props */
const LiveValue = ({ feature }) => feature && html`
  <small class="told-live">${words.toldLive(isMissing(feature) ? words.notEnough : number(feature.value))}</small>`;
