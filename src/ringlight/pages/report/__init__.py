"""The page of ``ringlight report``: how runs were trained, what they show, where they are wrong, how to repeat them."""
