// What a search puts first: pages and names whose title has the word; the changelog last.
var Scorer = {
  score: ([docname, title, anchor, descr, score]) =>
    /changelog/.test(docname) ? score - 100
      : /^(start|tutorials|how_to)\//.test(docname) ? score + 5
      : score,
  objNameMatch: 11,
  objPartialMatch: 6,
  objPrio: { 0: 15, 1: 5, 2: -5 },
  objPrioDefault: 0,
  title: 30,
  partialTitle: 15,
  term: 5,
  partialTerm: 2,
};
