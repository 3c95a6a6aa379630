/** What jsPsych takes for granted, and the oldest browsers that are served (package.json) lack. */

const builtin = Object as { hasOwn?: (object: object, name: PropertyKey) => boolean };

// Chrome before 93, Firefox before 92, Safari before 15.4.
builtin.hasOwn ??= (object, name) => Object.prototype.hasOwnProperty.call(object, name);
