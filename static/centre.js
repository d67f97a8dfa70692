// The centre's name and logo: read when the app starts, and after a change.
import { useEffect, useState } from './preact.js';
import { api } from './api.js';

/** @type {Schemas['CentreResponse']} */
let centre = { name: null, logo_version: null };
/** @type {Set<(centre: Schemas['CentreResponse']) => void>} */
const callbacks = new Set();

/** Reads them from the service; without an answer, the pages show the product's name. */
export const loadCentre = () => api.centre.get().then(showCentre, () => {});

/** Shows them on the page, for example after a change. @param {Schemas['CentreResponse']} changed */
export function showCentre(changed) {
  centre = changed;
  callbacks.forEach(callback => callback(centre));
}

/** The centre as it is known now. */
export function useCentre() {
  const [shown, setShown] = useState(centre);
  useEffect(() => {
    setShown(centre);
    callbacks.add(setShown);
    return () => void callbacks.delete(setShown);
  }, []);
  return shown;
}
