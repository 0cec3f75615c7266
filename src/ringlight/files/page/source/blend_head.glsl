// What a kind of model adds up along a pixel, called by blended().
void add(int row, bool turned, float weight, float depth);
