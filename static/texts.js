// Which language the pages speak, and its words. Another language is another file in texts/ with the same keys, and two lines here.
const KEY = 'trocar.language';
const FILES = { en: () => import('./texts/en.js'), de: () => import('./texts/de.js') };
/** Every language's name, in itself. */
export const LANGUAGES = { en: 'English', de: 'Deutsch' };

/** What the person chose, else the first of the browser's languages that is here, else English. */
export const language = [chosen(), ...browsers().map(plain), 'en'].find(one => Object.hasOwn(FILES, one));
/** The same as dates want it: with the region that the browser names, if it names one. */
export const region = browsers().find(one => plain(one) === language) ?? language;
/** The `lang` of a sentence that the service says in English; none where the page is English, too. */
export const theirs = language === 'en' ? undefined : 'en';

document.documentElement.lang = language;
// Only this one is loaded, and nothing is drawn before it is there: no page shows another language first.
export const { default: t } = await FILES[language]();

/** Every word is read once, when its module is loaded: a change takes a new page, at the same place. */
export function chooseLanguage(name) {
  try {
    localStorage.setItem(KEY, name);
  } catch {
    return; // Where storage is refused, a new page would be as this one.
  }
  location.reload();
}

function chosen() {
  try {
    return localStorage.getItem(KEY);
  } catch {
    return null; // Storage is refused (private window): the browser's languages stand.
  }
}

/** What a browser names is not always a language: Chromium may say `en-US@posix`, which dates would throw at. */
function browsers() {
  return (navigator.languages ?? []).filter(one => {
    try {
      return Intl.getCanonicalLocales(one).length > 0;
    } catch {
      return false;
    }
  });
}

function plain(one) {
  return one.split('-')[0].toLowerCase();
}
