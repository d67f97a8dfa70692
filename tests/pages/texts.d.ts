// The texts of a language. A text that is a function needs all of its arguments: JavaScript would accept fewer.
type Texts<T> = T extends (...args: any) => any
  ? [Parameters<T>] extends [never] // a parameter that is taken apart
    ? T
    : (...args: Required<Parameters<T>>) => ReturnType<T>
  : T extends object
    ? { [K in keyof T]: Texts<T[K]> }
    : T;
