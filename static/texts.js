// The language of the pages and its texts. To add a language, add a file with the same keys to texts/, and a line to
// FILES and to LANGUAGES.
const KEY = 'trocar.language';
const FILES = { en: () => import('./texts/en.js'), de: () => import('./texts/de.js') };
/** The name of each language, in that language. */
export const LANGUAGES = { en: 'English', de: 'Deutsch' };

/**
 * The language that the page is served in, which only a box's screen has; else the one that the user chose, else the first
 * of the browser's languages that Trocar has, else English.
 */
export const language = [document.documentElement.dataset.language, storedLanguage(), ...browserLanguages().map(baseLanguage), 'en'].find(tag => Object.hasOwn(FILES, tag));
/** The language tag for dates and numbers, with the region if the browser names one, such as `de-AT`. */
export const region = browserLanguages().find(tag => baseLanguage(tag) === language) ?? language;
/** The `lang` attribute for English sentences of the service; undefined if the page is English too. */
export const serviceLang = language === 'en' ? undefined : 'en';

document.documentElement.lang = language;
// Only this language is loaded, and nothing is drawn before, so that no page shows another language first.
const loaded = await FILES[language]();
/** @type {Texts<typeof import('./texts/en.js').default>} */
export const t = loaded.default;

/** Stores the choice and reloads the page, because modules read their texts only once, when they are loaded. */
export function chooseLanguage(name) {
  try {
    localStorage.setItem(KEY, name);
  } catch {
    return; // The browser refuses storage: a reload would show the same language again.
  }
  location.reload();
}

function storedLanguage() {
  try {
    return localStorage.getItem(KEY);
  } catch {
    return null; // The browser refuses storage (private window): its own languages decide.
  }
}

/** The valid language tags of the browser. Chromium may list `en-US@posix`, and formatting a date with that throws. */
function browserLanguages() {
  return (navigator.languages ?? []).filter(tag => {
    try {
      return Intl.getCanonicalLocales(tag).length > 0;
    } catch {
      return false;
    }
  });
}

function baseLanguage(tag) {
  return tag.split('-')[0].toLowerCase();
}
