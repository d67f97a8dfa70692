// The space that a feature is chosen in: in space or, where it is measured there too, in the image.
import { t } from '../../texts.js';

/** @typedef {Schemas['FeatureInfo']['spaces'][number]} Space */

const NAMES = { '3d': t.session.space3d, image: t.session.image };

/**
 * The spaces to choose from; a feature that is measured in one space leaves no choice.
 *
 * @param {Schemas['FeatureInfo'] | undefined} feature
 * @returns {[Space, string][]}
 */
export const spaceChoices = feature => (feature && feature.spaces.length > 1 ? feature.spaces.map(space => [space, NAMES[space]]) : []);

/**
 * A space that the feature is measured in: the named one, or its first.
 *
 * @param {Schemas['FeatureInfo'] | undefined} feature
 * @param {string} named
 */
export const spaceOf = (feature, named) => feature?.spaces.find(space => space === named) ?? feature?.spaces[0];
