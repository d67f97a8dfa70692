// Where the features of a session are compared: in space, or in the image where depth is poor.
import { html } from '../../preact.js';
import { percent } from '../../format.js';
import { t } from '../../texts.js';
import { Notice } from '../page/notice.js';

const words = t.session.comparedSpace;

/** The space that is shown first. Results without error bars state none. @param {Schemas['SessionResponse']} session */
export const firstSpace = session => session.compare_in?.space ?? '3d';

/**
 * The features of a space. What is measured in space alone is listed beside those of the image, too: times, and values
 * that need depth.
 *
 * @param {Schemas['FeatureResponse'][]} features
 * @param {string} space
 */
export function featuresIn(features, space) {
  if (space !== 'image') return features.filter(one => one.space === space);
  const inImage = new Set(features.filter(one => one.space === 'image').map(one => one.name));
  return features.filter(one => one.space === 'image' || !inImage.has(one.name));
}

/** That depth is poor, and how far off that makes a length; empty where it is good. @param {Props} props */
export const PoorDepth = ({ session: { compare_in: one } }) => one?.space === 'image' && html`
  <div class="chooser"><${Notice} tone="warn" title=${words.poorDepth}>${poorDepthText(one)}<//></div>`;

/** @param {NonNullable<Schemas['SessionResponse']['compare_in']>} one */
export const poorDepthText = ({ path_error_3d: inSpace, path_error_image: inImage }) =>
  words.poorDepthBody(wholePercent(inSpace), wholePercent(inImage));

const wholePercent = share => percent(Math.round(100 * share) / 100);

/**
 * Whether a value that needs depth may be off by more than half of itself. Shares and counts are no lengths: half of
 * them means nothing.
 *
 * @param {Schemas['FeatureResponse']} feature
 */
export const isTooUncertain = ({ needs_depth: needsDepth, error, value, unit }) =>
  Boolean(needsDepth && error && value !== null && /mm|rad/.test(unit) && error.high - error.low > Math.abs(value ?? 0));
