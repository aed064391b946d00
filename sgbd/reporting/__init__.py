"""For people: names of scores, pictures, the files of an evaluation, and the page that holds all of a run or sweep."""
