"""Tools of the people who change eskin: fuzzing, mutants, random designs, the documents' site. Not
installed."""
