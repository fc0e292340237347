"""Files in, arrays out: photographs and masks. Nothing is fitted here."""
