"""Output for people: names of scores, pictures, the files of an evaluation, and the page of a run or sweep."""
