// Which language the pages speak. A second one is a second file in texts/ with the same keys, and a line here.
import en from './texts/en.js';

export const t = en;
