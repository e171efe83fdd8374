"""The open library of effects, one small class each: ``effect`` says what one is, ``library`` lists them."""
